"""The harness of `rcdn bench`, with stand-ins for detectors: who is asked when, and what is made of it.
No real time is tested."""

import json
import os
from functools import partial

import cv2
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from rcdn.errors import ConfigError, RcdnError
from rcdn_lab.bench import rate, run
from rcdn_lab.bench.child import LIMITS, Broken, Child, Timing, limited
from rcdn_lab.bench.pictures import Cell, rendered
from rcdn_lab.bench.resident import resident
from rcdn_lab.bench.run import SB, Contestant, cells_of, contestants, in_turn, table
from rcdn_lab.cli.bench import bench
from rcdn_lab.peers import PEERS, Grid, Peer

SMALL = (200, 160)
BLANK = np.zeros((160, 200), np.uint8)


class StandIn:
    """A detector that takes the times it is told, one after the other and round again, and notes when it is asked."""

    def __init__(self, name, seconds, log, fail=None):
        self.name, self.seconds, self.log, self.fail = name, list(seconds), log, fail
        self.calls, self.closed = 0, False

    def time(self, image, size):
        self.log.append((self.name, size, int(image[0, 0])))
        if self.fail is not None and self.calls == self.fail:
            raise Broken("boom")
        taken = self.seconds[self.calls % len(self.seconds)]
        self.calls += 1
        return Timing(taken, 2 * taken, 54)

    def close(self):
        self.closed = True


def cell(*grey, board=(9, 6)):
    return Cell("board", SMALL, board, tuple(np.full((160, 200), g, np.uint8) for g in grey or (0,)))


def race(seconds, count=5, budget=1e9, of=None, boards=None, fail=None):
    """Rows by detector, the log, and the times of a race between stand-ins that take `seconds` by name."""
    log = []
    runners = {name: StandIn(name, s, log, (fail or {}).get(name)) for name, s in seconds.items()}
    who = [Contestant(n, lambda _, r=r: r, (boards or {}).get(n)) for n, r in runners.items()]
    rows = table([of or cell()], who, [1], count, budget)
    assert all(r.closed for r in runners.values())
    return {row["detector"]: row for row in rows}, log


# ---- turns


def test_everybody_warms_up_and_then_runs_once_a_round():
    _, log = race({"a": [1], "b": [1], "c": [1]}, count=6)
    names = [name for name, _, _ in log]
    assert len(names) == 3 + 18
    assert all(sorted(names[k : k + 3]) == ["a", "b", "c"] for k in range(0, 21, 3))
    assert len({tuple(names[k : k + 3]) for k in range(3, 21, 3)}) > 1, "never the same neighbour all the time"


def test_everybody_sees_the_same_picture_in_a_round_and_all_pictures():
    _, log = race({"a": [1], "b": [1]}, count=2, of=cell(10, 20, 30))
    assert [grey for _, _, grey in log] == [10, 10, 10, 10, 20, 20, 30, 30]


def test_a_detector_is_told_its_own_size_of_board():
    _, log = race({"a": [1], "b": [1]}, count=1, boards={"b": (7, 7)})
    assert {(name, size) for name, size, _ in log} == {("a", (9, 6)), ("b", (7, 7))}


# ---- figures


def test_medians_leave_the_warm_up_out():
    rows, _ = race({SB: [9.0, 0.010, 0.020, 0.030, 0.040, 0.100]})
    row = rows[SB]
    assert (row["ms"], row["iqr ms"], row["cpu ms"]) == (30, 20, 60)
    assert (row["repeats"], row["corners"], row["ratio"], row["note"]) == (5, 54, 1, "")


def test_the_ratio_is_of_the_same_round():
    """While both slow down tenfold together, the ratio stays."""
    rows, _ = race({SB: [1, 1, 10, 1, 10, 100], "a": [1, 3, 30, 3, 30, 300]})
    assert rows["a"]["ratio"] == pytest.approx(3)
    assert rows["a"]["pairs"] == 5


def test_without_the_yardstick_there_is_no_ratio():
    rows, _ = race({"a": [1.0]})
    assert rows["a"]["ratio"] is None
    assert rows["a"]["ms"] == 1000


def test_a_slow_detector_repeats_less_and_says_so():
    rows, log = race({SB: [0.1], "slow": [2.0]}, count=10, budget=7)
    assert (rows["slow"]["repeats"], rows[SB]["repeats"]) == (2, 10)
    assert rows["slow"]["note"] == "own threads, budget: 2 of 10"
    assert rows["slow"]["pairs"] == 2
    assert rows["slow"]["ratio"] == pytest.approx(20)
    assert [name for name, _, _ in log].count("slow") == 3


def test_who_spends_the_budget_on_the_warm_up_is_not_asked_again():
    rows, log = race({SB: [0.1], "slow": [8.0]}, budget=7)
    assert rows["slow"]["ms"] == 8000
    assert rows["slow"]["repeats"] == 1
    assert "not warmed up" in rows["slow"]["note"]
    assert [name for name, _, _ in log].count("slow") == 1


@pytest.mark.parametrize("when", [0, 3])
def test_a_detector_that_fails_has_a_row_and_the_others_go_on(when):
    rows, _ = race({SB: [1.0], "bad": [1.0]}, count=4, fail={"bad": when})
    assert rows["bad"]["note"] == "failed: boom"
    assert (rows["bad"]["ms"], rows["bad"]["ratio"], rows["bad"]["repeats"]) == (None, None, 0)
    assert rows[SB]["repeats"] == 4


def test_a_yardstick_that_fails_leaves_times_without_ratios():
    rows, _ = race({SB: [1.0], "a": [1.0]}, fail={SB: 2})
    assert rows["a"]["ratio"] is None
    assert rows["a"]["ms"] == 1000


def test_each_thread_count_has_a_runner_of_its_own():
    started = []

    def start(name, threads):
        started.append((name, threads))
        return StandIn(name, [float(threads)], [])

    rows = table([cell(), cell()], [Contestant(n, partial(start, n)) for n in (SB, "a")], [1, 2], 2, 99.0)
    assert sorted(started) == [("a", 1), ("a", 2), (SB, 1), (SB, 2)]
    assert [(r["threads"], r["ms"]) for r in rows] == [(1, 1000.0)] * 2 + [(2, 2000.0)] * 2 + [(1, 1000.0)] * 2 + [
        (2, 2000.0)
    ] * 2


def test_in_turn_keeps_what_was_skipped():
    found = in_turn(cell(), {"slow": StandIn("slow", [3.0], [])}, 5, 10.0)
    assert (len(found["slow"].timings), found["slow"].skipped) == (2, 3)


# ---- who runs, on what


def test_we_come_first_and_the_yardstick_comes_with_any_peer():
    who, missing = contestants(["auto", "paper"], ["opencv"])
    assert [c.name for c in who] == ["rcdn", "rcdn-paper", SB, "opencv"]
    assert missing == {}
    assert [c.name for c in contestants(["auto"], ["none"])[0]] == ["rcdn"]
    everybody, lacking = contestants(["auto"], ["auto"])
    assert {"rcdn", *PEERS} == {*(c.name for c in everybody), *lacking}


@pytest.mark.parametrize(("presets", "peers"), [(["best"], ["none"]), ([], ["none"]), (["auto"], ["nobody"])])
def test_unknown_contestants_are_refused(presets, peers):
    with pytest.raises(ConfigError, match=r"auto"):
        contestants(presets, peers)


def test_a_peer_with_boards_of_its_own_gets_them_together_with_the_yardstick():
    who = [Contestant("rcdn", None), Contestant(SB, None), Contestant("square", None, (7, 7))]
    made = list(cells_of([SMALL], (5, 4), who))
    assert [(c.kind, c.board, c.only) for c in made] == [
        ("board", (5, 4), ("rcdn", SB)), ("board", (7, 7), (SB, "square")), ("clutter", (5, 4), ()),
        ("texture", (5, 4), ()),
    ]  # fmt: skip
    assert all(c.pictures[0].shape == (160, 200) and c.pictures[0].dtype == np.uint8 for c in made)


@pytest.mark.parametrize(("size", "board"), [((640, 480), (9, 6)), ((400, 300), (7, 7)), ((300, 500), (9, 6))])
def test_the_board_is_there_whole_and_the_clutter_holds_none(size, board):
    image = rendered("board", size, board)
    assert image.shape == size[::-1]
    found, corners = cv2.findChessboardCornersSB(image, board)
    assert found
    hull = cv2.contourArea(cv2.convexHull(corners)) * np.prod(np.array(board) + 1) / np.prod(np.array(board) - 1)
    assert 0.2 < hull / np.prod(size) < 0.5  # without the quiet zone; tall frames hold a smaller board
    for kind in ("clutter", "texture"):
        empty = rendered(kind, size, board)
        assert empty.shape == size[::-1]
        assert empty.std() > 20
        assert not cv2.findChessboardCornersSB(empty, board)[0]


def test_a_board_that_fits_nowhere_is_refused():
    with pytest.raises(ConfigError, match="doesn't fit"):
        rendered("board", (160, 160), (90, 90))


# ---- processes


def obedient():
    return lambda image, size: [Grid(np.zeros((size[0] * size[1], 2)))]


def moody():
    """Fails on grey 1, dies on grey 2, else says how it is limited: cores, threads of OpenCV,
    an environment variable."""

    def find(image, size):
        if image[0, 0] == 1:
            raise ValueError("grey 1")
        if image[0, 0] == 2:
            os._exit(7)
        limits = (len(os.sched_getaffinity(0)), cv2.getNumThreads(), int(os.environ[LIMITS[0]]))
        return [Grid(np.zeros((n, 2))) for n in (limits if image[0, 0] == 3 else (1,))]

    return find


def unmakeable():
    raise OSError("no such engine")


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="needs processor affinity")
def test_a_child_times_fails_dies_and_comes_back():
    with Child(moody, 1) as child:
        timing = child.time(BLANK, (9, 6))
        assert timing.corners == 1
        assert timing.seconds > 0
        with pytest.raises(Broken, match="ValueError: grey 1"):
            child.time(BLANK + 1, (9, 6))
        assert child.time(BLANK + 3, (9, 6)).corners == 3  # one core, one thread, told so
        with pytest.raises(Broken, match="exit code 7"):
            child.time(BLANK + 2, (9, 6))
        assert child.time(BLANK, (9, 6)).corners == 1


def test_a_child_whose_detector_cannot_be_made_says_why():
    child = Child(unmakeable, 1)
    with pytest.raises(Broken, match="no such engine"):
        child.time(BLANK, (9, 6))
    with pytest.raises(Broken, match="no such engine"):
        child.time(BLANK, (9, 6))  # again: it says so each time


@pytest.mark.skipif(resident("VmRSS") is None, reason="needs /proc")
def test_memory_of_a_child_is_its_own():
    """Not the parent's, which holds 300 MB here: rusage would say so."""
    ballast = np.ones(300_000_000, np.uint8)
    with Child(obedient, 1) as child:
        assert child.time(BLANK, (3, 3)).corners == 9
        taken = child.memory()
    assert 20 < taken.before <= taken.peak < resident("VmRSS") - 100
    assert ballast.all()


def test_limits_are_lifted_again(monkeypatch):
    monkeypatch.setenv(LIMITS[0], "7")
    monkeypatch.delenv(LIMITS[1], raising=False)
    with limited(3):
        assert {os.environ[name] for name in LIMITS} == {"3"}
    assert os.environ[LIMITS[0]] == "7"
    assert LIMITS[1] not in os.environ


# ---- the command


def sweep_file(path, rows, preset="auto"):
    path.write_text(json.dumps({"settings": {"preset": preset}, "rows": rows}))
    return path


def success(detector, *values):
    return [{"detector": detector, "success": value} for value in values]


@pytest.fixture
def command(monkeypatch):
    """The verb, all detectors replaced by stand-ins: ours takes 2 s, the yardstick 1 s,
    one peer breaks down, one isn't there."""
    times = {"rcdn": [2.0], SB: [1.0], "broken": [1.0]}
    made = [Contestant(n, lambda _, n=n: StandIn(n, times[n], [], 0 if n == "broken" else None)) for n in times]
    absent = Peer("absent", "free", lambda: "not installed: pip install absent", lambda: "1", lambda: None)
    monkeypatch.setitem(PEERS, "absent", absent)
    monkeypatch.setattr(run, "contestants", lambda presets, peers: (made, {"absent": absent.missing()}))
    app = typer.Typer()
    app.command()(bench)
    return lambda *words: CliRunner().invoke(app, ["--sizes", "200x160", "--threads", "1", *map(str, words)])


def test_the_command_leaves_table_json_markdown_and_plot(command, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib", reason="plots need matplotlib")
    quality = sweep_file(tmp_path / "sweep.json", success("rcdn", 1, 0.5) + success(SB, 0.5))
    row = {"task": "a", "of peak": 0.9}
    monkeypatch.setattr(rate, "rate", lambda count: [row | {"rounds": count}])
    result = command(
        "--count", 3, "--parts", "speed,memory,rate", "--json", tmp_path / "a.json", "--markdown", tmp_path / "a.md",
        "--plot", tmp_path / "a.png", "--sweep", quality,
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "a.json").read_text())
    assert found["suite"] == "bench"
    assert {"commit", "date", "platform"} <= set(found["provenance"])
    assert found["settings"]["machine"].keys() == {"processor", "cores", "memory GB", "load", "load after"}
    assert found["settings"]["skipped"] == {"absent": "not installed: pip install absent"}
    ours = [r for r in found["speed"] if r["detector"] == "rcdn"]
    assert [(r["picture"], r["ms"], r["ratio"], r["repeats"]) for r in ours] == [
        ("board", 2000, 2, 2), ("clutter", 2000, 2, 2), ("texture", 2000, 2, 2),
    ]  # fmt: skip
    assert {r["note"] for r in found["speed"] if r["detector"] == "broken"} == {"failed: boom"}
    assert {r["detector"] for r in found["memory"]} == {"rcdn", SB, "broken"}
    assert found["rate"] == [row | {"rounds": 3}]
    assert "skipped absent: not installed: pip install absent" in result.output
    assert "| task | of peak | rounds |\n| --- | --- | --- |\n| a | 0.9 | 3 |" in (tmp_path / "a.md").read_text()
    assert "| rcdn | 2000 (2.00) |" in (tmp_path / "a.md").read_text()
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--sizes", "640"), "--sizes: '640'"), (("--sizes", "10x10"), "160 to 10000"),
        (("--sizes", ","), "at least one"), (("--threads", "0"), "--threads"), (("--threads", "x"), "--threads"),
        (("--parts", "all"), "known: speed"), (("--csv", "a.csv"), "--folder"),
        (("--folder-plot", "a.png"), "--folder N"), (("--folder-jobs", "0"), "--folder-jobs"),
        (("--plot", "a.txt"), "must end in"),
    ],
)  # fmt: skip
def test_wrong_words_are_told(command, words, message):
    result = command("--parts", "none", *words)
    assert isinstance(result.exception, ConfigError), result.output
    assert message in str(result.exception)


def test_a_file_that_cannot_be_written_is_told_before_the_work(command, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "table", lambda *_: pytest.fail("worked first"))
    (tmp_path / "file").write_text("")
    result = command("--json", tmp_path / "file" / "a.json")
    assert isinstance(result.exception, RcdnError)
