"""The command: rows, files, peers that fail or aren't there."""

import csv
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from rcdn.cli import app
from rcdn.errors import ConfigError
from rcdn_lab import sweep
from rcdn_lab.peers import PEERS, Peer
from rcdn_lab.plots.sweep_plot import draw_factor
from rcdn_lab.sweep import run


def command(*words):
    return CliRunner().invoke(app, ["evaluate", "sweep", "--count", "1", *map(str, words)])


def test_the_command_leaves_table_json_csv_and_plots(tmp_path):
    pytest.importorskip("matplotlib", reason="plots need matplotlib")
    files = {name: tmp_path / name for name in ("a.json", "a.csv", "plots")}
    result = command(
        "--factor", "falloff", "--peers", "opencv", "--workers", 1,
        "--json", files["a.json"], "--csv", files["a.csv"], "--plots", files["plots"],
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    record = json.loads(files["a.json"].read_text())
    assert set(record["settings"]["peers"]) == {"opencv"}
    rows = record["rows"]
    assert [(r["factor"], r["level"]) for r in rows if r["detector"] == "rcdn"] == [
        ("falloff", level) for level in sweep.FACTORS["falloff"]
    ]
    dark = next(r for r in rows if r["level"] == "5" and r["detector"] == "rcdn")
    assert dark["success"] == dark["recall"] == 1
    assert 0 < dark["mean px"] < 0.1
    assert dark["ratio"] == pytest.approx(dark["mean px"] / dark["bound px"], rel=0.05)
    assert {r["size"] for r in rows if r["detector"] == "opencv"} == {"given"}
    with files["a.csv"].open() as handle:
        assert [r["level"] for r in csv.DictReader(handle)] == [r["level"] for r in rows]
    assert sorted(p.name for p in files["plots"].iterdir()) == ["sweep_falloff.png"]
    assert "falloff" in result.output


def test_the_rows_do_not_depend_on_the_workers():
    one, two = (sweep.table(1, ["fisheye"], workers=n) for n in (1, 2))
    assert one == two


@pytest.mark.parametrize(
    ("words", "message"),
    [(("--factor", "colour"), "known: noise"), (("--peers", "nobody"), "known: auto"), (("--preset", "x"), "auto or")],
)
def test_wrong_words_are_told(words, message):
    result = command(*words)
    assert result.exit_code == 2
    assert message in result.stderr


def test_which_peers_run():
    names, lacking = sweep.contestants(["auto"])
    assert {*names, *lacking} == set(PEERS)
    assert {"opencv", "opencv-sb"} <= set(names)
    assert sweep.contestants(["none"]) == sweep.contestants([]) == ([], {})
    with pytest.raises(ConfigError, match="nobody"):
        sweep.contestants(["opencv", "nobody"])


def test_plots_leave_gaps_where_there_is_no_figure():
    figure = pytest.importorskip("matplotlib.figure", reason="plots need matplotlib").Figure()
    blank = {"factor": "empty", "recall": None, "mean px": None, "bound px": None}
    rows = [blank | {"level": level, "detector": "a", "success": s} for level, s in (("x", 1.0), ("y", 0.5))]
    draw_factor(figure, "empty", [*rows, blank | {"level": "y", "detector": "b", "success": None, "factor": "other"}])
    lines = {line.get_label(): line.get_ydata().tolist() for line in figure.axes[0].lines}
    assert lines == {"a": [1.0, 0.5]}
    assert np.isnan(figure.axes[2].lines[0].get_ydata()).all()


@pytest.fixture
def quick(monkeypatch):
    """Three levels of the cheapest pictures, our detector blind, no bound: what is tested is who is asked."""
    monkeypatch.setitem(sweep.FACTORS, "shadow", {k: sweep.Setting(square=15, shadow=0.5) for k in "abc"})
    monkeypatch.setattr(run.Detector, "boards", lambda self, image: [])
    monkeypatch.setattr(run, "bounds", lambda scene: [np.ones(b.cols * b.rows) for b in scene.boards])


def pretend(monkeypatch, **changes):
    """A peer called `pretender` that finds nothing, unless `changes` say otherwise."""
    peer = Peer(**{
        "name": "pretender", "size": "given", "missing": lambda: None, "version": lambda: "1",
        "load": lambda: lambda image, size: [],
    } | changes)  # fmt: skip
    monkeypatch.setitem(PEERS, "pretender", peer)


def shadow_rows():
    return [r for r in sweep.table(1, ["shadow"], ["pretender"]) if r["detector"] == "pretender"]


@pytest.mark.usefixtures("quick")
def test_a_peer_that_fails_is_counted(monkeypatch):
    def fail(image, size):
        raise RuntimeError("no")

    pretend(monkeypatch, load=lambda: fail)
    assert [(r["failed"], r["success"], r["recall"]) for r in shadow_rows()] == [(1, 0, 0)] * 3
    assert {r["first failure"] for r in shadow_rows()} == {"#0 RuntimeError: no"}


@pytest.mark.usefixtures("quick")
def test_a_peer_that_is_not_installed_is_skipped_and_says_so(monkeypatch):
    pretend(monkeypatch, missing=lambda: "not installed: pip install pretender")
    result = command("--factor", "shadow", "--peers", "pretender", "--workers", 1)
    assert result.exit_code == 0
    assert "skipped pretender: not installed: pip install pretender" in result.output


@pytest.mark.usefixtures("quick")
def test_a_peer_may_ask_for_boards_of_its_own(monkeypatch):
    calls = []

    def note(image, size):
        calls.append((size, image.shape))
        return []

    pretend(monkeypatch, load=lambda: note, board=(7, 7))
    assert {r["size"] for r in shadow_rows()} == {"given 7x7"}
    assert calls == [((7, 7), (480, 640))] * 3


@pytest.mark.usefixtures("quick")
def test_our_own_failure_is_counted_too(monkeypatch):
    def fail(self, image):
        raise RuntimeError("ours")

    monkeypatch.setattr(run.Detector, "boards", fail)
    assert {(r["failed"], r["success"]) for r in sweep.table(1, ["shadow"])} == {(1, 0)}


@pytest.mark.usefixtures("quick")
def test_pictures_come_in_grey_bytes(monkeypatch):
    seen = []
    monkeypatch.setattr(run.Detector, "boards", lambda self, image: seen.append(image) or [])
    sweep.table(1, ["shadow"])
    assert {image.dtype for image in seen} == {np.dtype(np.uint8)}
