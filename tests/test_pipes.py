"""Results in pipes and in the order that people count: `--json -`, `--quiet`, natural order, what isn't complete,
drawings skipped."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from detector_stand_in import StandIn, picture
from rcdn.batch import pool
from rcdn.cli import app
from rcdn.cli import detect as verb
from rcdn.io import expand, find, read_detections, read_image, read_vnl, write_image
from rcdn.io.finding import natural


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Run `rcdn ARGUMENTS` in a temporary folder, with a stand-in detector and without processes."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(verb, "_make_detector", StandIn)
    monkeypatch.setattr(pool, "usable_cores", lambda: 1)

    def go(*arguments):
        return CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)

    return go


# ---- pipes


def test_json_on_standard_output_is_what_the_file_would_hold_and_all_else_goes_to_stderr(run):
    for k in range(3):
        picture(Path(f"{k}.png"), missing=k)
    Path("bad.png").write_bytes(b"no picture")
    filed = run("detect", ".", "--json", "out.json")
    piped = run("detect", ".", "--json", "-")
    assert (filed.exit_code, piped.exit_code) == (1, 1)
    assert piped.stdout == Path("out.json").read_text()
    assert "pictures  complete" in piped.stderr
    assert "bad.png: not a picture" in piped.stderr
    assert not Path("-").exists()


def test_quiet_says_nothing_but_errors(run):
    picture(Path("a.png"))
    Path("bad.png").write_bytes(b"no picture")
    result = run("detect", ".", "--quiet", "--json", "out.json")
    assert (result.exit_code, result.stdout) == (1, "")
    assert len(result.stderr.splitlines()) == 1
    piped = run("detect", "a.png", "-q", "--json", "-")
    assert piped.stderr == ""
    assert len(json.loads(piped.stdout)["images"]) == 1
    assert "complete" in run("detect", "a.png").stdout  # the next run speaks again


def test_vnl_on_standard_output_too_but_not_both(run):
    picture(Path("a.png"))
    result = run("detect", "a.png", "--vnl", "-", "-q")
    assert result.stdout.startswith("# filename x y level\na.png ")
    assert run("detect", "a.png", "--vnl", "-", "--json", "-").exit_code == 2


def test_a_reader_that_has_enough_ends_the_command_without_words(tmp_path):
    for k in range(3):
        picture(tmp_path / f"{k}.png")
    command = [sys.executable, "-m", "rcdn", "detect", str(tmp_path), "-j", "1", "-q", "--json", "-"]
    ours, theirs = os.pipe()
    os.close(ours)
    done = subprocess.run(command, stdout=theirs, stderr=subprocess.PIPE, text=True, check=False, timeout=120)
    os.close(theirs)
    assert (done.returncode, done.stderr) == (1, "")


# ---- order


def test_natural_order_counts_and_never_fails():
    names = ["b/1.png", "a/img10.png", "a/img2.png", "a/img02.png", "a/img2b.png", "a10/x.png", "a9/x.png", "7", "x"]
    assert sorted(names, key=natural) == [
        "7", "a/img02.png", "a/img2.png", "a/img2b.png", "a/img10.png", "a9/x.png", "a10/x.png", "b/1.png", "x",
    ]  # fmt: skip
    rng = random.Random(3)
    for _ in range(300):
        odd = ["".join(rng.choices("a0/9١²\udc80", k=rng.randint(0, 9))) for _ in range(8)]
        once = sorted(odd, key=natural)
        rng.shuffle(odd)
        assert [natural(n) for n in sorted(odd, key=natural)] == [natural(n) for n in once]


def test_results_come_in_natural_order_everywhere(run):
    for k in (10, 9, 1, 2, 100):
        picture(Path(f"in/img{k}.png"), missing=k % 3)
    result = run("detect", "in", "--json", "out.json", "--vnl", "out.vnl")
    wanted = [f"in/img{k}.png" for k in (1, 2, 9, 10, 100)]
    assert [i.path for i in read_detections("out.json")[0]] == wanted
    assert list(read_vnl("out.vnl")) == wanted
    assert [line.split()[0] for line in result.stdout.splitlines()[:5]] == wanted
    assert [str(p) for p in expand(["in/img*.png"])[0]] == wanted
    named = [Path("in/img9.png"), Path("in/img10.png"), Path("in/img2.png")]
    assert expand(named)[0] == named
    listed = sorted(wanted)  # as a shell lists in/*.png
    assert listed != wanted
    assert [str(p) for p in expand(["other.png", *listed])[0]] == wanted
    assert [str(p) for p in expand([*listed[:2], "in/none.png", *listed[2:]])[0]] == listed  # not a shell's


# ---- what isn't complete


def test_of_many_pictures_those_that_are_not_complete_are_listed(run):
    for k in range(25):
        picture(Path(f"in/{k}.png"), missing=2 * (k in (3, 17)))
    picture(Path("in/none.png"), cols=0, rows=0)
    Path("in/bad.png").write_bytes(b"no picture")
    lines = run("detect", "in").stdout.splitlines()
    assert [line.split()[0] for line in lines[: lines.index("")]] == [
        "in/3.png",
        "in/17.png",
        "in/bad.png",
        "in/none.png",
    ]
    assert lines[0].endswith("9×6 partial (52 of 54)")
    assert lines[2].split(maxsplit=1)[1].startswith("failed: not a picture")


def test_of_many_complete_pictures_none_is_listed(run):
    for k in range(25):
        picture(Path(f"in/{k}.png"))
    assert run("detect", "in").stdout.split()[0] == "pictures"


# ---- drawings


def test_overlays_are_never_taken_for_pictures_again(run):
    for k in range(3):
        picture(Path(f"in/{k}.png"))
    assert run("detect", "in", "--overlay", "in/seen").exit_code == 0
    result = run("detect", "in", "--json", "out.json")
    assert result.exit_code == 0
    assert [i.path for i in read_detections("out.json")[0]] == ["in/0.png", "in/1.png", "in/2.png"]
    assert result.stderr == "note: 3 pictures that rcdn made of others are skipped: in/seen/0.png, …\n"
    assert [str(p) for p in find(["in/seen/*.png", "in/0.png"]).files] == ["in/0.png"]
    assert "all drawings of rcdn's" in run("detect", "in/seen").stderr
    assert expand(["in/seen/0.png"])[0] == [Path("in/seen/0.png")]  # who names it means it


def test_undistorted_pictures_are_read_where_there_is_nothing_else(run):
    image = read_image(picture(Path("in/a.png")))
    Path("in/flat").mkdir()
    write_image("in/flat/a.png", image, mark="rcdn undistorted")
    write_image("in/flat/b.jpg", image, mark="rcdn undistorted")
    found = find(["in"])
    assert found.files == [Path("in/a.png")]
    assert found.own == [Path("in/flat/a.png"), Path("in/flat/b.jpg")]
    assert find(["in/flat"]).files == found.own
