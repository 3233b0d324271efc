"""Many inputs: several processes, their deaths, the cache, saved detections, and videos."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import fields, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import detector_stand_in as stand_in
from detector_stand_in import (
    BROKEN,
    KILL,
    KILL_ONCE,
    LIMIT,
    LIMITED,
    MARKS,
    SLOW,
    BrightSquare,
    StandIn,
    picture,
    video,
)
from rcdn.batch import inputs as _inputs
from rcdn.batch import pool
from rcdn.batch.cache import Cache
from rcdn.batch.work import Failure, Picture, Work, in_thread, read_ahead
from rcdn.cli import app
from rcdn.cli import detect as verb
from rcdn.config import DetectorConfig
from rcdn.errors import ConfigError, RcdnError
from rcdn.io import ImageResult, read_detections, write_detections, write_vnl
from rcdn.terminal import console
from rcdn.types import Charuco, Corners

CONFIG = DetectorConfig()


@pytest.fixture
def marks(monkeypatch, tmp_path):
    """What the detectors of all processes did, as a list of (what, process)."""
    folder = tmp_path / "marks"
    folder.mkdir()
    monkeypatch.setenv(MARKS, str(folder))
    return lambda: [tuple(p.name.rsplit(" ", 2)[:2]) for p in folder.iterdir()]


@pytest.fixture
def home(monkeypatch, tmp_path):
    """An empty current folder."""
    folder = tmp_path / "home"
    folder.mkdir()
    monkeypatch.chdir(folder)
    console.begin()  # as every command does
    return folder


@pytest.fixture
def run(monkeypatch, home, marks):
    """Run `rcdn detect ARGUMENTS` with the stand-in."""
    monkeypatch.setattr(verb, "_make_detector", StandIn)
    return lambda *arguments: CliRunner().invoke(app, ["detect", *map(str, arguments)], catch_exceptions=False)


def same(a, b):
    """True if two results are equal bit for bit."""
    if (a.path, a.width, a.height, len(a.boards)) != (b.path, b.width, b.height, len(b.boards)):
        return False
    pairs = zip((a.corners, *a.boards), (b.corners, *b.boards), strict=True)
    return all(np.array_equal(getattr(x, f.name), getattr(y, f.name)) for x, y in pairs for f in fields(x))


def outcomes(paths, jobs, make=StandIn, cache=None):
    work = Work(partial(make, CONFIG), cache)
    pictures = read_ahead(paths, decode=jobs == 1, cache=cache)
    return [done.outcomes for done in pool.compute(pictures, work, jobs)]


# ---- warnings


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_limits_left_out_is_told_and_written_also_from_the_cache(run, jobs):
    picture(Path("in/usual.png"))
    picture(Path("in/much.png"), missing=LIMITED)
    for again in (False, True):
        result = run("in", "--json", "out.json", "--cache", "cache", "--jobs", jobs)
        assert result.exit_code == 0
        assert result.stderr.splitlines() == ["warning: in/much.png: too many; far too many"], again
        images, _ = read_detections("out.json")
        assert {Path(i.path).name: i.warnings for i in images} == {"usual.png": (), "much.png": LIMIT}


def test_what_limits_left_out_is_told_before_a_calibration(home, capfd):
    picture(Path("much.png"), missing=LIMITED)
    got = gather("much.png")
    assert got.images[0].warnings == LIMIT
    assert capfd.readouterr().err == "warning: much.png: too many; far too many\n"


def test_warnings_of_which_the_caller_speaks_are_kept_but_not_printed(home, capsys):
    picture(Path("much.png"), missing=LIMITED)
    got = gather("much.png", silent="far too")
    assert got.images[0].warnings == LIMIT == ("too many", "far too many")
    assert capsys.readouterr().err == "warning: much.png: too many\n"
    gather("much.png", silent="")
    assert capsys.readouterr().err == "warning: much.png: too many; far too many\n"


def test_what_a_file_read_twice_is_warned_of_is_printed_once_a_command(home, capsys):
    picture(Path("much.png"), missing=LIMITED)
    Path("text.png").write_text("no picture")
    both = []
    for _ in range(2):
        console.begin()
        first, again = (gather("much.png", "text.png") for _ in range(2))
        assert len(first.failures) == len(again.failures) == 1
        both.append(capsys.readouterr().err)
    assert both[0] == both[1]
    assert both[0].count("warning: much.png") == both[0].count("error: text.png") == 1


def test_warnings_of_many_pictures_are_printed_thrice_and_then_counted(run, home, capsys):
    for k in range(6):
        picture(Path(f"in/{k}.png"), missing=LIMITED)
    lines = [f"warning: in/{k}.png: too many; far too many" for k in range(3)]
    lines.append("warning: 3 more pictures: too many; far too many")
    result = run("in", "--json", "out.json")
    assert result.stderr.splitlines() == lines
    assert [i.warnings for i in read_detections("out.json")[0]] == 6 * [LIMIT]
    console.begin()
    gather("in")
    gather("in")  # a second reading adds nothing to the count
    assert capsys.readouterr().err.splitlines() == lines


# ---- processes


def test_outputs_are_the_same_bytes_for_any_number_of_processes(run):
    for k in range(7):
        picture(Path(f"in/{k}.png"), cols=3 + k, missing=k % 2)
    picture(Path("in/broken.png"), cols=BROKEN)
    picture(Path("in/more/0.png"))
    Path("in/zero.png").write_bytes(b"")
    video(Path("in/clip.avi"), [(5, 5)] * 4)
    printed, written = set(), []
    for jobs in (1, 2, 3):
        result = run(
            "in", "missing.png", "-j", jobs, "--json", "out.json", "--vnl", "out.vnl", "--overlay", f"see{jobs}"
        )
        assert result.exit_code == 1
        printed.add(result.stderr)
        overlays = {p.name: p.read_bytes() for p in Path(f"see{jobs}").iterdir()}
        written.append((Path("out.json").read_bytes(), Path("out.vnl").read_bytes(), overlays))
    assert written[0] == written[1] == written[2]
    assert len(printed) == 1
    images, errors = read_detections("out.json")
    assert [i.path for i in images] == [
        *(f"in/{k}.png" for k in range(7)), *(f"in/clip.avi#{k:06d}" for k in range(4)), "in/more/0.png",
    ]  # fmt: skip
    assert [name for name, _ in errors] == ["missing.png", "in/broken.png", "in/zero.png"]
    assert len(written[0][2]) == 12


def test_several_processes_share_the_work_and_each_makes_one_detector(run, marks):
    for k in range(12):
        picture(Path(f"{k:02d}.png"))
    assert run("*.png", "-j", "3").exit_code == 0
    processes = {process for _, process in marks()}
    assert str(os.getpid()) not in processes
    assert 1 <= len(processes) <= 3


@pytest.mark.parametrize(("count", "jobs"), [(2, 4), (5, 1)])
def test_few_pictures_and_one_job_need_no_process(run, marks, count, jobs):
    for k in range(count):
        picture(Path(f"{k}.png"))
    run("*.png", "-j", jobs)
    assert [process for _, process in marks()] == [str(os.getpid())] * count


def test_jobs_and_threads(monkeypatch):
    monkeypatch.setattr(pool, "usable_cores", lambda: 8)
    paths = [Path(f"{k}.png") for k in range(5)]
    assert pool.jobs_for(0, paths) == 5
    assert pool.jobs_for(3, paths) == 3
    assert pool.jobs_for(0, paths[:2]) == 1
    assert pool.jobs_for(0, [Path("a.mp4")]) == 8
    assert pool.config_of_process(CONFIG, 1).threads == 0
    assert pool.config_of_process(CONFIG, 2).threads == 1
    assert pool.config_of_process(DetectorConfig(threads=3), 2).threads == 3


def test_a_killed_process_loses_nothing(home, marks):
    paths = [picture(Path(f"{k}.png"), cols=KILL_ONCE if k in (0, 4) else 3 + k, missing=k) for k in range(8)]
    results = outcomes(paths, 2)
    assert [r.path for (r,) in results] == [str(p) for p in paths]
    seen = [what.split()[0] for what, _ in marks()]
    assert seen.count(str(KILL_ONCE)) == 4  # two pictures, each of which killed the first process that saw it
    assert all(seen.count(str(3 + k)) == 1 for k in (1, 2, 3, 5, 6, 7))


def test_a_picture_that_kills_twice_is_reported_by_name_and_the_others_go_on(run, marks):
    for k in range(6):
        picture(Path(f"{k}.png"), cols=KILL if k == 2 else 3 + k)
    result = run("*.png", "-j", "2", "--json", "out.json")
    assert result.exit_code == 1
    images, errors = read_detections("out.json")
    assert [i.path for i in images] == [f"{k}.png" for k in (0, 1, 3, 4, 5)]
    ((name, message),) = errors
    assert name == "2.png"
    assert message.startswith("2.png: ")
    assert "two processes ended" in message
    assert [what.split()[0] for what, _ in marks()].count(str(KILL)) == 2


def test_a_detector_that_can_not_be_made_is_one_error(run, monkeypatch):
    for k in range(4):
        picture(Path(f"{k}.png"))
    monkeypatch.setattr(verb, "_make_detector", stand_in.NoDetector)
    for jobs in (1, 2):
        result = run("*.png", "-j", jobs)
        assert (result.exit_code, result.stderr) == (1, "error: onnxruntime is missing: install it\n")


def test_processes_that_end_at_once_are_one_error(home):
    paths = [picture(Path(f"{k}.png")) for k in range(4)]
    with pytest.raises(RcdnError, match=r"SIGKILL.*--jobs 1"):
        outcomes(paths, 2, make=stand_in.ends_at_once)


def test_an_overlay_that_can_not_be_written_does_not_keep_the_others(run):
    for k in range(6):
        picture(Path(f"{k}.png"))
    Path("see/2.png").mkdir(parents=True)
    for jobs in (1, 2):
        result = run("*.png", "-j", jobs, "--overlay", "see", "--json", "out.json")
        assert result.exit_code == 1
        assert result.stderr == "error: see/2.png: can't be written: it is a folder; give the name of a file in it\n"
        assert [i.path for i in read_detections("out.json")[0]] == [f"{k}.png" for k in range(6)]
        assert sorted(p.name for p in Path("see").iterdir()) == [f"{k}.png" for k in range(6)]


def test_results_come_in_order_frozen_and_not_far_ahead(home):
    path = picture(Path("a.png"))
    taken = []

    def source():
        for k in range(500):
            taken.append(k)
            yield Picture(k, str(k), None, path=path)

    results = pool.compute(source(), Work(partial(StandIn, CONFIG)), 2)
    for k in range(20):
        done = next(results)
        assert (done.index, done.name) == (k, str(k))
        assert len(taken) <= k + 1 + 2 * pool.BEHIND
    (image,) = done.outcomes
    assert not image.corners.xy.flags.writeable
    assert not image.boards[0].xy.flags.writeable
    results.close()


def test_a_reader_s_error_is_raised_where_it_is_read():
    def broken():
        yield 1
        raise KeyError("reader")

    items = in_thread(broken)
    assert next(items) == 1
    with pytest.raises(KeyError, match="reader"):
        next(items)


CTRL_C = """
import detector_stand_in, sys
from rcdn.cli import app, detect
detect._make_detector = detector_stand_in.StandIn
if __name__ == "__main__":
    app(["detect", *sys.argv[1:]], prog_name="rcdn")
"""


def started(folder, *arguments):
    """The command in a process group of its own, as a terminal would start it."""
    (folder / "command.py").write_text(CTRL_C)
    paths = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [sys.executable, "command.py", *arguments], cwd=folder, env=os.environ | {"PYTHONPATH": paths}, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
    )  # fmt: skip


def wait_for(condition, seconds=60):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never happened"
        time.sleep(0.05)


def alive(process):
    """True if a process runs (a zombie doesn't)."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="process groups of POSIX")
def test_ctrl_c_ends_all_processes_and_writes_what_is_done(home, marks):
    for k in range(6):
        picture(Path(f"{k}.png"), cols=SLOW if k in (3, 4) else 9)
    command = started(home, *(f"{k}.png" for k in range(6)), "--jobs", "2", "--json", "out.json")
    wait_for(lambda: [what.split()[0] for what, _ in marks()].count(str(SLOW)) == 2)
    os.killpg(command.pid, signal.SIGINT)
    out, err = command.communicate(timeout=60)
    assert command.returncode == 130
    assert err == "error: stopped by Ctrl-C after 3 pictures of 6 files; out.json holds what was found in them\n"
    assert "Traceback" not in out
    assert [i.path for i in read_detections("out.json")[0]] == ["0.png", "1.png", "2.png"]
    assert not [p.name for p in home.iterdir() if p.name.endswith(".tmp")]
    assert not any(alive(process) for _, process in marks())


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="process groups of POSIX")
def test_processes_end_when_the_command_is_killed(home, marks):
    for k in range(6):
        picture(Path(f"{k}.png"), cols=SLOW if k == 5 else 9)
    command = started(home, *(f"{k}.png" for k in range(6)), "--jobs", "2", "--cache", "kept")
    wait_for(lambda: len(marks()) == 6)
    slow = {process for what, process in marks() if what.startswith(str(SLOW))}
    idle = {process for _, process in marks()} - slow
    command.kill()
    command.wait(timeout=60)
    wait_for(lambda: not any(alive(process) for process in idle))
    for process in slow:  # it would end after its picture
        os.kill(int(process), signal.SIGKILL)
    command.communicate(timeout=60)


# ---- the cache in a run


def test_a_killed_run_goes_on_where_it_stopped(home, marks, run):
    for k in range(6):
        picture(Path(f"{k}.png"), cols=SLOW if k == 5 else 3 + k)
    names = [f"{k}.png" for k in range(6)]
    command = started(home, *names, "--jobs", "1", "--cache", "kept")
    wait_for(lambda: any(what.startswith(str(SLOW)) for what, _ in marks()))
    command.kill()
    command.communicate(timeout=60)
    picture(Path("5.png"), cols=8)
    before = marks()
    result = run(*names, "--cache", "kept", "--json", "again.json", "--overlay", "see")
    assert result.exit_code == 0
    new = set(marks()) - set(before)
    assert {what for what, _ in new} == {"8 6 0"}
    assert run(*names, "--json", "fresh.json", "-j", "1").exit_code == 0
    assert Path("again.json").read_bytes() == Path("fresh.json").read_bytes()
    assert len(list(Path("see").iterdir())) == 6


def test_detect_keeps_nothing_unless_it_is_told_to(run, home, marks, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "usual"))
    picture(Path("a.png"))
    run("a.png")
    run("a.png")
    assert len(marks()) == 2
    assert not (tmp_path / "usual").exists()


@pytest.mark.parametrize("jobs", [1, 2])
def test_known_pictures_are_not_computed_and_are_the_same(home, marks, jobs):
    cache = Cache(home / "kept", "salt")
    paths = [picture(Path(f"{k}.png"), cols=3 + k, missing=k % 3) for k in range(6)]
    plain = outcomes(paths, 1)
    first = outcomes(paths, jobs, cache=cache)
    count = len(marks())
    second = outcomes(paths, jobs, cache=cache)
    assert len(marks()) == count == 12
    for (a,), (b,), (c,) in zip(plain, first, second, strict=True):
        assert same(a, b)
        assert same(a, c)


def test_a_changed_picture_is_computed_again_and_a_renamed_one_is_not(home, marks):
    cache = Cache(home / "kept", "salt")
    outcomes([picture(Path("a.png"), cols=5), picture(Path("b.png"), cols=6)], 1, cache=cache)
    os.rename("a.png", "c.png")
    picture(Path("b.png"), cols=7)
    results = outcomes([Path("c.png"), Path("b.png")], 1, cache=cache)
    assert [(r.path, r.boards[0].size) for (r,) in results] == [("c.png", (5, 6)), ("b.png", (7, 6))]
    assert sorted(what for what, _ in marks()) == ["5 6 0", "6 6 0", "7 6 0"]


def test_failures_are_not_kept(home, marks):
    cache = Cache(home / "kept", "salt")
    path = picture(Path("a.png"), cols=BROKEN)
    for _ in range(2):
        ((failure,),) = outcomes([path], 1, cache=cache)
        assert isinstance(failure, Failure)
    assert len(marks()) == 2


# ---- what a calibration is given


def gather(*inputs, make=StandIn, **options):
    return _inputs.gather([str(i) for i in inputs], CONFIG, make=make, **({"jobs": 1} | options))


def saved(path, *names, errors=()):
    images = [ImageResult(n, 100, 80, Corners([[1.0, 2.0]], [1.0], [0]), ()) for n in names]
    write_detections(path, images, errors)
    return path


def test_inputs_of_all_kinds_in_their_order(home, capsys):
    picture(Path("in/b.png"))
    picture(Path("in/a.png"), cols=0, rows=0)
    picture(Path("p1.jpg"), cols=0, rows=0)
    picture(Path("z.png"))
    saved("d.json", "x.png", "y.png", errors=[("w.png", "w.png: empty")])
    picture(Path("v.png"))
    write_vnl("c.vnl", outcomes([Path("v.png")], 1)[0])
    got = gather("z.png", "d.json", "in", "p*.jpg", "c.vnl", size=(9, 6))
    assert [i.path for i in got.images] == ["z.png", "x.png", "y.png", "in/a.png", "in/b.png", "p1.jpg", "v.png"]
    assert got.failures == ()
    assert got.notes == ("d.json: 1 file could not be read when it was written: w.png",)
    assert capsys.readouterr().err == ""
    assert [len(i.boards) for i in got.images] == [1, 0, 0, 0, 1, 0, 1]
    assert got.images[-1].boards[0].size == (9, 6)


def test_a_picture_and_its_saved_detections_count_once(home):
    picture(Path("a.png"))
    saved("d.json", "a.png", "b.png")
    assert [len(i.corners) for i in gather("a.png", "d.json").images] == [55, 1]
    assert [len(i.corners) for i in gather("d.json", "a.png", home / "a.png").images] == [1, 1]


def test_saved_boards_that_are_not_as_asked_are_told(home):
    picture(Path("a.png"))
    (found,) = outcomes([Path("a.png")], 1)[0]
    plain = found.boards[0]
    ids = np.arange(len(plain)) + 1
    coded = replace(plain, target=Charuco(10, 7, "DICT_4X4_50", 0.75), ids=ids)
    images = [ImageResult(f"{k}.png", 100, 80, found.corners, (b,)) for k, b in enumerate((plain, coded, coded))]
    write_detections("d.json", images, ())

    def notes(**settings):
        return _inputs.gather(["d.json"], DetectorConfig(**settings), jobs=1, make=StandIn).notes

    assert notes() == notes(target=Charuco(10, 7, "DICT_4X4_50", 0.75)) == ()
    assert notes(target="plain") == ("d.json: 2 boards with codes, used as saved: --target is for pictures",)
    asked = notes(pattern="deltille", target="plain")
    assert asked[0] == "d.json: 3 boards of squares, used as saved: --pattern is for pictures"
    assert len(asked) == 2


@pytest.mark.parametrize("inputs", [["missing.png"], ["empty"], ["*.tif"], [""], []])
def test_nothing_to_read(home, inputs, capsys):
    Path("empty").mkdir()
    with pytest.raises(ConfigError, match="nothing to read"):
        gather(*inputs)
    assert len(capsys.readouterr().err.splitlines()) == len(inputs)


def test_bad_files_of_all_kinds_are_reported_and_the_others_go_on(home, capsys):
    picture(Path("good.png"))
    picture(Path("bug.png"), cols=BROKEN)
    for name in ("zero.png", "zero.avi"):
        Path(name).write_bytes(b"")
    Path("text.png").write_text("no picture")
    Path("bad.json").write_text("{}")
    Path("bad.vnl").write_text("a.png 1\n")
    Path("empty").mkdir()
    bad = ["zero.png", "zero.avi", "text.png", "bad.json", "bad.vnl", "bug.png", "missing.png", "empty"]
    got = gather(*bad[:4], "good.png", *bad[4:])
    assert [i.path for i in got.images] == ["good.png"]
    assert {f.name for f in got.failures} == set(bad)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == len(bad)
    assert all(text.startswith("error: ") and any(name in text for name in bad) for text in lines)


@pytest.mark.parametrize("jobs", [1, 2])
def test_gather_uses_the_cache(home, marks, jobs):
    cache = Cache(home / "kept", "salt")
    for k in range(5):
        picture(Path(f"{k}.png"), cols=3 + k)
    first = gather("*.png", jobs=jobs, cache=cache)
    count = len(marks())
    second = gather("*.png", jobs=jobs, cache=cache)
    assert (count, len(marks())) == (5, 5)
    assert all(map(same, first.images, second.images))


# ---- videos of a calibration

CORNERS = [(10, 10), (110, 10), (10, 80), (110, 80)]
PLACES = [None] * 10 + [place for place in CORNERS for _ in range(6)] + [None] * 5


@pytest.mark.parametrize("jobs", [1, 2])
def test_of_a_video_different_frames_with_boards_are_used(home, marks, jobs):
    clip = video(Path("clip.avi"), PLACES)
    got = gather(clip, make=BrightSquare, jobs=jobs)
    places = [min(CORNERS, key=lambda c: float(np.abs(i.boards[0].xy.min(axis=0) - c).sum())) for i in got.images]
    assert places == CORNERS  # in time, each once
    (numbers,) = got.frames
    assert [i.path for i in got.images] == [f"clip.avi#{k:06d}" for k in numbers]
    assert [(k - 10) // 6 for k in numbers] == [0, 1, 2, 3]
    assert got.notes == ("clip.avi: 4 frames are used, of 4 with a board, of 5 sharp and different ones, of 39",)
    assert len(marks()) == 5


def test_a_video_without_a_board_is_not_said_to_be_unread(home):
    video(Path("clip.avi"), [None] * 12)
    result = CliRunner().invoke(app, ["calibrate", "clip.avi", "--spacing", "25mm", "-j", "1", "--no-cache"])
    assert result.exit_code == 1
    assert "no board was found in the frames that were looked at" in result.stderr


def test_frames_bounds_how_many_are_used(home):
    clip = video(Path("clip.avi"), PLACES)
    all_four, two = gather(clip, make=BrightSquare), gather(clip, make=BrightSquare, frames=2)
    assert len(two.images) == 2
    assert set(two.frames[0]) < set(all_four.frames[0])
    a, b = (i.boards[0].xy.mean(axis=0) for i in two.images)
    assert np.abs(a - b).min() > 50  # opposite corners: the farthest


def test_a_known_video_is_not_even_decoded(home, marks, monkeypatch):
    cache = Cache(home / "kept", "salt")
    clip = video(Path("clip.avi"), PLACES)
    first = gather(clip, make=BrightSquare, cache=cache)
    monkeypatch.setattr("rcdn.io.frames", lambda path: pytest.fail("decoded"))
    second = gather(clip, make=BrightSquare, cache=cache)
    assert len(marks()) == 5
    assert all(map(same, first.images, second.images))
    assert (first.frames, first.notes) == (second.frames, second.notes)


def test_a_half_known_video_gives_the_same(home, marks):
    cache = Cache(home / "kept", "salt")
    clip = video(Path("clip.avi"), PLACES)
    first = gather(clip, make=BrightSquare, cache=cache)
    for path in sorted(cache.folder.rglob("*.json"))[::2]:
        path.unlink()
    second = gather(clip, make=BrightSquare, cache=cache)
    assert all(map(same, first.images, second.images))
    assert first.frames == second.frames
    assert 0 < len(marks()) - 5 < 5


def test_the_other_camera_s_frames_can_be_asked_for(home):
    left, right = video(Path("left.avi"), PLACES), video(Path("right.avi"), PLACES[1:])
    picture(Path("a.png"), 0, 0)
    numbers = gather(left, make=BrightSquare).frames
    got = gather("a.png", right, make=BrightSquare, numbers=numbers)
    assert [i.path for i in got.images] == ["a.png", *(f"right.avi#{k:06d}" for k in numbers[0])]
    assert got.frames == numbers
    too_far = gather(right, make=BrightSquare, numbers=((3, 999),))
    assert too_far.frames == ((3,),)


def test_detect_gives_all_frames(run):
    video(Path("clip.avi"), PLACES[8:15])
    run("clip.avi", "--json", "out.json", "-j", "2")
    assert len(json.loads(Path("out.json").read_text())["images"]) == 7
