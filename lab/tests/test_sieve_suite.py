"""`rcdn evaluate sieve`: counts of known answers, and the command."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from rcdn.cli import app
from rcdn.corners import response
from rcdn.corners.response import load_model
from rcdn.corners.sieve import cells_with_saddles
from rcdn.errors import ConfigError
from rcdn.pyramid import View, whole_views
from rcdn_lab import sieve as suite
from rcdn_lab.sweep import FACTORS, Setting, picture
from rcdn_lab.sweep.pictures import seed_of

PLAIN = picture(Setting(), seed_of("noise", "3", 0))


class Blind:
    """The network of `auto` behind a sieve that marks the cells that `rule` says."""

    def __init__(self, rule):
        self.model, self.rule = load_model("auto"), rule

    def cells_of(self, part):
        return self.rule(np.ones([-(-n // 4) for n in part.shape], bool))

    def __call__(self, part, threads):
        return self.model(part, threads)


def left_half(cells):
    return cells & (np.arange(cells.shape[1]) < cells.shape[1] // 2)


def test_nothing_is_lost_where_all_is_marked():
    count = suite.counted(Blind(lambda cells: cells), PLAIN)
    assert count.kept == count.peaks >= count.corners == count.found > 54
    assert count.marked == count.cells == 160 * 120 + 80 * 60 + 40 * 30


def test_all_is_lost_where_nothing_is_marked():
    count = suite.counted(Blind(lambda cells: cells & False), PLAIN)
    assert (count.kept, count.found, count.marked) == (0, 0, 0)
    assert count.corners > 54


def test_half_is_lost_where_half_is_marked(monkeypatch):
    """Corners in the left half of the picture, of the one view that is looked at."""
    monkeypatch.setattr(suite, "whole_views", lambda shape: whole_views(shape)[:1])
    for index in range(3):
        made = picture(Setting(square=35), seed_of("square", "35", index))
        count = suite.counted(Blind(left_half), made)
        truth = made.boards[0].xy[made.boards[0].visible]
        middle = made.image.shape[1] // 2
        assert count.corners == len(truth) == 54
        near = np.abs(truth[:, 0] - middle) < 3
        left = (truth[:, 0] < middle)[~near].sum()
        assert left <= count.found <= left + near.sum()


def test_the_sieve_itself_is_measured():
    count = suite.counted(load_model("auto"), PLAIN)
    assert count.found == count.corners > 54
    assert 0 < count.marked < count.cells / 2


def test_a_network_without_a_sieve_is_told():
    with pytest.raises(ConfigError, match="no sieve"):
        suite.counted(load_model("paper"), PLAIN)


def test_peaks_belong_to_the_nearest_corner_within_reach():
    """At half the scale 2 px are 4 of the picture; squares of 25 px let 8.75."""
    board = PLAIN.boards[0]
    corner = board.xy[board.visible][0]
    whole, half = View((0, 0, 640, 480)), View((0, 0, 640, 480), 0.5)
    for view, near, far in ((whole, 1.9, 2.1), (half, 3.9, 4.1)):
        for gap, count in ((near, 1), (far, 0)):
            at = (corner + [gap, 0] + 0.5) * view.ratio() - 0.5
            assert suite._owner(view, np.array([[0.0, 0], at]), [board]).tolist() == [1] * count
    assert suite._owner(whole, np.zeros((0, 2)), [board]).tolist() == []
    assert suite._owner(whole, np.zeros((3, 2)), []).tolist() == []
    tight = PLAIN.boards[0].pitch * 0 + 4.0  # squares of 4 px: 1.4 px
    small = type(board)(board.xy, board.ij, board.visible, board.ignore, tight)
    assert suite._owner(whole, corner[None] + [[1.5, 0]], [small]).tolist() == []


def row(factor, level, *counts):
    return suite._row(factor, level, suite.Count(*counts))


ROWS = [
    row("a", "1", 100, 99, 90, 90, 1000, 300), row("a", "2", 50, 40, 40, 30, 1000, 500),
    row("b", "x", 10, 10, 10, 9, 1000, 0), row("c", "none", 7, 6, 0, 0, 1000, 100),
]  # fmt: skip


def test_rows_say_what_is_lost():
    assert (ROWS[1]["recall"], ROWS[1]["lost"], ROWS[1]["recall of peaks"], ROWS[1]["share of cells"]) == (
        0.75,
        10,
        0.8,
        0.5,
    )
    assert (ROWS[3]["recall"], ROWS[3]["lost"]) == (None, 0)
    assert suite.worst(ROWS) == "a 2"
    assert suite.worst([ROWS[0], ROWS[3]]) == "-"


def test_factors_add_up():
    a, b, c, total = suite.by_factor([*ROWS, row("all", "a 2", 167, 155, 140, 129, 4000, 900)])
    assert (a["factor"], a["worst"], a["of worst"], a["corners"], a["lost"]) == ("a", "a 2", 0.75, 130, 10)
    assert a["recall"] == pytest.approx(120 / 130, abs=1e-6)
    assert a["recall of peaks"] == pytest.approx(139 / 150, abs=1e-6)
    assert (b["worst"], b["recall"]) == ("b x", 0.9)
    assert (c["worst"], c["of worst"], c["recall"]) == ("-", None, None)
    assert (total["factor"], total["worst"], total["of worst"], total["lost"], total["peaks"]) == (
        "all",
        "a 2",
        0.75,
        11,
        167,
    )


@pytest.fixture
def two_levels(monkeypatch):
    monkeypatch.setitem(FACTORS, "noise", {"0": Setting(noise=0), "60": Setting(noise=60)})


@pytest.mark.usefixtures("two_levels")
def test_the_command_leaves_a_table_and_a_file(tmp_path):
    out = tmp_path / "s.json"
    words = ["--count", "1", "--factor", "noise", "--workers", "1", "--json", str(out)]
    result = CliRunner().invoke(app, ["evaluate", "sieve", *words])
    assert result.exit_code == 0, result.output
    record = json.loads(out.read_text())
    assert {"commit", "date", "platform", "versions"} <= set(record["provenance"])
    assert record["settings"]["count"] == 1
    rows = record["rows"]
    assert [(r["factor"], r["level"]) for r in rows[:-1]] == [("noise", "0"), ("noise", "60")]
    assert rows[-1]["factor"] == "all"
    assert rows[-1]["corners"] == rows[0]["corners"] + rows[1]["corners"] > 200
    assert rows[-1]["recall"] > 0.99
    assert [line.split()[0] for line in result.output.splitlines()[:3]] == ["factor", "noise", "all"]


@pytest.mark.usefixtures("two_levels")
def test_a_sieve_that_is_too_strict_is_seen(monkeypatch):
    monkeypatch.setattr(response, "cells_with_saddles", lambda grey: cells_with_saddles(grey, 0.8))
    rows = suite.table(1, ["noise"])
    assert rows[-1]["recall"] < 0.97
    assert rows[-1]["level"] == suite.worst(rows[:-1]) != "-"
    assert rows[-1]["lost"] == sum(r["lost"] for r in rows[:-1]) > 0


def test_an_unknown_factor_is_told():
    result = CliRunner().invoke(app, ["evaluate", "sieve", "--factor", "colour"])
    assert result.exit_code == 2
    assert "known: noise" in result.stderr
