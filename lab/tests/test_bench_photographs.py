"""`rcdn bench --photographs`, with stand-ins for detectors: which pictures, who is asked when, and the arithmetic.
No real time is tested."""

import json
from math import sqrt

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from rcdn.errors import ConfigError, FormatError
from rcdn.io import write_image
from rcdn_lab.bench import run, stages, yardstick
from rcdn_lab.bench.child import Broken, Timing
from rcdn_lab.bench.chosen import Photograph, chosen
from rcdn_lab.bench.photographs import Figure, figures
from rcdn_lab.bench.pictures import rendered
from rcdn_lab.bench.run import SB, Contestant
from rcdn_lab.bench.textured import KINDS, texture
from rcdn_lab.cli.bench import bench
from rcdn_lab.peers import Grid
from rcdn_lab.peers.base import lattice

SIZE = (3, 2)
CORNERS = 10.0 + 8 * lattice(SIZE)
BOARD = Grid(CORNERS, lattice(SIZE))


class StandIn:
    """A detector that takes so many processor seconds, and twice as many of the clock,
    and always finds the same grids."""

    def __init__(self, name, cpu, grids, log, fails_on=None):
        self.name, self.cpu, self.grids, self.log, self.fails_on = name, list(cpu), tuple(grids), log, fails_on
        self.calls = 0

    def time(self, image, size):
        self.log.append((self.name, size, int(image[0, 0])))
        if image[0, 0] == self.fails_on:
            raise Broken("boom")
        taken = self.cpu[self.calls % len(self.cpu)]
        self.calls += 1
        return Timing(2 * taken, taken, 0, self.grids)

    def close(self):
        self.log.append((self.name, "closed", 0))


def contestant(name, cpu, log, grids=(), board=None, fails_on=None):
    return Contestant(name, lambda threads: StandIn(f"{name} {threads}", cpu, grids, log, fails_on), board)


def picture(name, grey=0, corners=CORNERS, shape=(50, 100)):
    return Photograph(name, f"{grey}.png", np.full(shape, grey, np.uint8), SIZE, corners, ordered=True)


EMPTY = np.zeros((0, 2))


def figure(name, detector, cpu, ratio, whole=True, **more):
    known = {"megapixels": 1.0, "empty": False, "threads": 1, "rounds": 3, "alarm": None} | more
    return Figure(
        set=name, detector=detector, cpu=cpu, wall=2 * cpu, cpu_ratio=ratio, wall_ratio=ratio, whole=whole, **known
    )


# ---- who is asked when


def test_all_detectors_and_threads_take_turns_on_each_picture():
    log = []
    who = [contestant("rcdn", [1], log), contestant(SB, [1], log), contestant("other", [1], log, board=(7, 7))]
    figures([picture("a", 1), picture("a", 2)], who, [1, 2], 4, 99)
    turns = [(name, grey) for name, size, grey in log if size == SIZE]
    assert len(turns) == 4 + 2 * 4 * 4  # warmed up once; who knows other boards only isn't asked
    rounds = [turns[k : k + 4] for k in range(4, len(turns), 4)]
    assert all(sorted(name for name, _ in r) == sorted(["rcdn 1", "rcdn 2", f"{SB} 1", f"{SB} 2"]) for r in rounds)
    assert [r[0][1] for r in rounds] == [1] * 4 + [2] * 4
    assert len({tuple(r) for r in rounds[:4]}) > 1
    assert sum(size == "closed" for _, size, _ in log) == 6


def test_figures_are_a_megapixel_and_ratios_of_the_same_round():
    """In the second of three rounds everything takes ten times as long: the ratio stays."""
    log = []
    who = [contestant("rcdn", [9, 0.3, 3, 0.3], log, [BOARD]), contestant(SB, [9, 0.1, 1, 0.1], log)]
    found, failures = figures([picture("a")], who, [1], 3, 99)
    ours, base = sorted(found, key=lambda f: f.detector != "rcdn")
    assert (ours.cpu, ours.wall, ours.rounds) == pytest.approx((60_000, 120_000, 3))  # 0.3 s for .005 megapixels
    assert (base.cpu_ratio, base.wall_ratio, ours.cpu_ratio) == pytest.approx((3, 3, 1))
    assert (ours.whole, base.whole, ours.alarm) == (True, False, None)
    assert failures == {}


def test_who_spends_the_budget_repeats_less():
    found, _ = figures([picture("a")], [contestant("slow", [1], []), contestant("quick", [0.1], [])], [1], 5, 5.0)
    assert {f.detector: f.rounds for f in found} == {"slow": 2, "quick": 5}
    assert all(f.cpu_ratio is None for f in found), "we weren't there"


def test_who_fails_on_a_picture_has_no_figure_of_it_and_says_why():
    who = [contestant("rcdn", [1], []), contestant("bad", [1], [], fails_on=7)]
    found, failures = figures([picture("a", 3), picture("b", 7)], who, [1], 2, 99)
    assert [(f.set, f.detector) for f in found] == [("a", "rcdn"), ("a", "bad"), ("b", "rcdn")]
    assert failures == {"bad": "boom"}


# ---- what is found


@pytest.mark.parametrize(
    ("grids", "whole"),
    [
        ([BOARD], True), ([], False), ([Grid(CORNERS[:-1], lattice(SIZE)[:-1])], False), ([Grid(CORNERS)], False),
        ([Grid(CORNERS, lattice(SIZE)[::-1])], True), ([Grid(CORNERS, lattice(SIZE)[[1, 0, 2, 3, 4, 5]])], False),
        ([Grid(CORNERS + 5, lattice(SIZE)), Grid(CORNERS + 1, lattice(SIZE))], True),
        ([Grid(np.vstack([CORNERS, [[90, 40]]]), np.vstack([lattice(SIZE), [[3, 1]]]))], False),
    ],
)  # fmt: skip
def test_a_board_is_whole_with_all_corners_no_other_and_right_labels(grids, whole):
    assert picture("a").is_whole(grids) is whole


def test_nothing_is_judged_where_nothing_is_known():
    assert picture("a", corners=None).is_whole([BOARD]) is None
    assert picture("a", corners=EMPTY).is_whole([BOARD]) is None
    assert (picture("a", corners=EMPTY).is_empty, picture("a", corners=None).is_empty) == (True, False)
    found, _ = figures([picture("a", corners=EMPTY)], [contestant("rcdn", [1], [], [BOARD])], [1], 1, 99)
    assert (found[0].alarm, found[0].whole, found[0].empty) == (True, None, True)


# ---- arithmetic


def test_means_are_geometric_over_pictures_and_then_over_sets():
    """Set a: 2 and 8, mean 4; set b: 9. Together 6, whatever the number of pictures in each."""
    mine = [figure("a", SB, 2, 0.5), figure("a", SB, 8, 2.0), figure("b", SB, 9, 0.25, whole=False)]
    row = next(r for r in yardstick.summary(mine) if r["pictures"] == "boards")
    assert (row["cpu ms/MP"], row["ms/MP"], row["sets"], row["count"]) == (6, 12, 2, 3)
    assert (row["rcdn ÷ it"], row["where found"]) == (0.5, 1)  # of 1 and 1/4, and of the first alone
    assert (row["worst"], row["worst set"], row["whole"], row["false"]) == (1, "a", "2/3", "-")
    assert yardstick.geometric([]) is None
    assert yardstick.geometric([2, 8]) == pytest.approx(4)


def test_a_peer_that_is_missing_somewhere_is_measured_on_the_rest():
    mine = [figure("a", "rcdn", 4, 1.0), figure("b", "rcdn", 16, 1.0), figure("b", "peer", 2, None, whole=None)]
    rows = {r["detector"]: r for r in yardstick.summary(mine)}
    assert (rows["rcdn"]["cpu ms/MP"], rows["peer"]["cpu ms/MP"], rows["peer"]["sets"]) == (8, 2, 1)
    assert (rows["peer"]["rcdn ÷ it"], rows["peer"]["worst"], rows["peer"]["worst set"]) == (None, None, "-")
    assert rows["peer"]["whole"] == "-"
    by_set = [r for r in yardstick.sets(mine) if r["time"] == "cpu"]
    assert [(r["set"], r["rcdn"], r["peer"]) for r in by_set] == [("a", 4, None), ("b", 16, 2)]
    assert all(r[f"rcdn ÷ {SB}"] is None for r in by_set)
    tables = {"photographs": yardstick.summary(mine), "sets": yardstick.sets(mine), "found": yardstick.found(mine)}
    assert "| a | 1.00 | 4 | – | – | – |" in "\n".join(yardstick.text(tables))


def test_small_pictures_and_those_without_a_board_are_groups_of_their_own():
    mine = [
        figure("a", "rcdn", 4, 1.0), figure("a", "rcdn", 9, 1.0, megapixels=0.09),
        figure("n", "rcdn", 5, 1.0, whole=None, empty=True, alarm=False),
        figure("n", "rcdn", 7, 1.0, whole=None, empty=True, alarm=True, megapixels=0.09),
    ]  # fmt: skip
    rows = {r["pictures"]: r for r in yardstick.summary(mine)}
    means = [round(r["cpu ms/MP"] ** 2) for r in rows.values()]
    assert list(rows) == ["boards", "boards, under 0.1 MP", "no board", "no board, under 0.1 MP"]
    assert means == [36, 81, 35, 49]
    assert (rows["boards"]["whole"], rows["no board"]["false"]) == ("2/2", "1/2")
    assert [(r["set"], r["what"], r["rcdn"]) for r in yardstick.found(mine)] == [
        ("a", "whole", "2/2"),
        ("n", "false", "1/2"),
    ]


def test_threads_and_kinds_of_time_have_rows_of_their_own():
    mine = [figure("a", name, 4.0 / n, 1.0 / n, threads=n) for n in (1, 2) for name in ("rcdn", SB)]
    rows = {(r["threads"], r["time"]): r for r in yardstick.sets(mine)}
    assert {key: row["rcdn"] for key, row in rows.items()} == {
        (1, "cpu"): 4,
        (1, "wall"): 8,
        (2, "cpu"): 2,
        (2, "wall"): 4,
    }
    text = yardstick.text(
        {"photographs": yardstick.summary(mine), "sets": list(rows.values()), "found": yardstick.found(mine)}
    )
    assert [part.count("\n") for part in text] == [3, 3, 2]
    assert text[0].startswith("| photographs, 1 thread:")
    assert f"| {SB} | 4.0 (1.00) |" in text[0]


def test_stages_of_a_class_weigh_pictures_by_their_pixels():
    def rows(nms, whole, calls):
        return [{"stage": "nms", "ms": nms, "calls": calls}, {"stage": "whole", "ms": whole, "calls": None}]

    found = stages.class_rows("small", [(1.0, rows(1, 10, 2)), (3.0, rows(7, 30, 4))])
    assert [(r["stage"], r["ms/MP"], r["share"], r["calls"]) for r in found] == [
        ("nms", 2, 0.2, 3),
        ("whole", 10, 1, 0),
    ]
    names = [stages.class_of(picture("a", shape=shape)) for shape in ((50, 100), (500, 1000), (2000, 1000))]
    assert names == ["boards, 0 MP to 0.1 MP", "boards, 0.5 MP to 2 MP", "boards, 2 MP and more"]
    assert stages.class_of(picture("a", corners=EMPTY)).startswith("no board")


# ---- which pictures


@pytest.fixture
def folder(tmp_path):
    """Two sets and one without boards; of set `b` the boards have no one size, of `c` nothing is known."""

    def image(xy):
        return {"xy": xy, "ordered": True}

    sets = {
        "a": {"board": SIZE, "exhaustive": True, "images": {f"{k}.png": image(CORNERS.tolist()) for k in range(5)}},
        "b": {"board": None, "exhaustive": True, "images": {"0.png": image([[1, 2]]), "1.png": image(None)}},
        "c": {"board": None, "exhaustive": True, "images": {"0.png": image(None)}},
        "none": {"board": None, "exhaustive": True, "images": {f"{k:02}.png": image([]) for k in range(30)}},
    }
    sets["a"]["images"]["0.png"]["xy"] = None
    for name, record in sets.items():
        (tmp_path / name).mkdir()
        for file in record["images"]:
            write_image(tmp_path / name / file, np.full((50, 100), 7, np.uint8))
    (tmp_path / "truth.json").write_text(json.dumps(sets))
    return tmp_path


def test_the_choice_is_fixed_and_of_known_truth_only(folder):
    found = chosen(folder, (9, 6))
    assert [f"{p.set}/{p.file}" for p in found[:3]] == ["a/1.png", "a/3.png", "b/0.png"]
    assert [p.file for p in found[3:]] == [f"{3 * k // 2:02}.png" for k in range(20)]
    assert [(p.board, p.is_empty) for p in found[1:4]] == [(SIZE, False), ((9, 6), False), ((9, 6), True)]
    assert found[2].corners is None
    assert np.array_equal(found[0].corners, CORNERS)


def test_without_truth_all_pictures_are_one_set(folder):
    (folder / "truth.json").unlink()
    found = chosen(folder / "a", (9, 6))
    assert [(p.set, p.board, p.corners) for p in found] == [("a", (9, 6), None)] * 5


def test_a_folder_that_is_none_or_empty_or_wrong_is_told(folder):
    with pytest.raises(ConfigError, match="no folder"):
        chosen(folder / "nowhere", SIZE)
    (folder / "empty").mkdir()
    with pytest.raises(ConfigError, match="no pictures"):
        chosen(folder / "empty", SIZE)
    for wrong in ("[1]", '{"a": {"images": {"0.png": {}}}}', "no"):
        (folder / "truth.json").write_text(wrong)
        with pytest.raises(FormatError, match=r"truth\.json"):
            chosen(folder, SIZE)


# ---- texture


@pytest.mark.parametrize("kind", KINDS)
def test_textures_are_normal_and_fixed(kind):
    one, two = (texture((160, 120), kind, np.random.default_rng(3)) for _ in range(2))
    assert np.array_equal(one, two)
    assert (one.shape, abs(float(one.mean())) < 1e-5, float(one.std())) == (
        (120, 160),
        True,
        pytest.approx(1, abs=1e-4),
    )


def test_textured_clutter_is_rough_everywhere():
    """Neighbours differ by more than the sensor's noise alone (3 √2 levels) in every part of the picture."""
    step = np.abs(np.diff(rendered("texture", (640, 480), (9, 6)).astype(float), axis=1))
    parts = step[:480, :600].reshape(4, 120, 4, 150).mean(axis=(1, 3))
    assert parts.min() > 2 * 3 * sqrt(2)


# ---- the command


def test_the_command_times_photographs_and_no_other_part(folder, tmp_path, monkeypatch):
    made = [contestant("rcdn", [0.02], [], [BOARD]), contestant(SB, [0.01], [])]
    monkeypatch.setattr(run, "contestants", lambda presets, peers: (made, {}))
    app = typer.Typer()
    app.command()(bench)
    files = tmp_path / "a.json", tmp_path / "a.md"
    words = ["--photographs", folder, "--threads", "1", "--rounds", 2, "--json", files[0], "--markdown", files[1]]
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    record = json.loads(files[0].read_text())
    assert {name for name in ("photographs", "sets", "found", "speed", "memory") if name in record} == {
        "photographs",
        "sets",
        "found",
    }
    row = next(r for r in record["photographs"] if (r["pictures"], r["detector"]) == ("boards", SB))
    assert (row["rcdn ÷ it"], row["cpu ms/MP"], row["sets"], row["whole"]) == (2, 2000, 2, "0/2")
    assert (record["settings"]["rounds"], len(record["settings"]["chosen"])) == (2, 23)
    assert record["settings"]["photographs"] == folder.name
    assert "2000 (2.00)" in files[1].read_text()
    assert "set" in result.output
