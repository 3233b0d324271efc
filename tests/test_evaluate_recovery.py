"""`rcdn evaluate recovery`: both recoveries on the same corners."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from rcdn_lab import recovery as suite
from rcdn_lab.cli.evaluate import app
from rcdn_lab.plots import recovery as report


@pytest.fixture
def few(monkeypatch):
    """Two kinds of pictures only."""
    monkeypatch.setattr(suite, "KINDS", {kind: suite.KINDS[kind] for kind in ("planar", "no board")})
    monkeypatch.setattr(report, "SHEET", ("planar", "no board"))


def test_rows_and_pictures_of_the_command(few, tmp_path):
    result = CliRunner().invoke(
        app, ["recovery", "--count", "1", "--pictures", str(tmp_path / "seen"), "--json", str(tmp_path / "r.json")]
    )
    assert result.exit_code == 0, result.output
    record = json.loads((tmp_path / "r.json").read_text())
    rows = {(row["kind"], row["corners of"]): row for row in record["rows"]}
    assert list(rows) == [(k, p) for k in ("planar", "no board", "ALL") for p in ("auto", "paper")]
    plain = rows["planar", "auto"]
    assert (plain["boards"], plain["whole growth"], plain["whole graph"]) == (1, 1, 1)
    assert (plain["recall growth"], plain["recall graph"]) == (1, 1)
    assert plain["labels growth"] == plain["labels graph"] == 0
    assert rows["no board", "auto"]["recall graph"] is None
    for column in ("pictures", "boards", "corners seen", "wrong growth", "false graph"):
        assert rows["ALL", "paper"][column] == sum(rows[k, "paper"][column] for k in ("planar", "no board"))
    names = sorted(p.name for p in (tmp_path / "seen").iterdir())
    assert names == ["no_board-auto.jpg", "no_board-paper.jpg", "planar-auto.jpg", "planar-paper.jpg", "recovery.jpg"]
    assert cv2.imread(str(tmp_path / "seen" / "recovery.jpg")).shape[1] > 2 * 2 * report.WIDTH


def test_both_see_the_same_corners_and_the_least_number_counts():
    made = suite.picture(suite.KINDS["occluded"], suite.seed_of("recovery", "occluded", 0))
    for case in suite.cases("occluded", made.image, 9):
        known = set(map(tuple, case.found.corners.xy.tolist()))
        assert all(set(map(tuple, b.xy.tolist())) <= known for b in case.growth)
        assert all(len(b) >= 9 for b in case.growth + case.graph)


def test_the_gallery_keeps_the_first_case_that_differs():
    image = np.full((60, 80), 128, np.uint8)
    (case, _) = suite.cases("planar", image, 9)
    assert not case.differ
    made = suite.picture(suite.KINDS["planar"], suite.seed_of("recovery", "planar", 0))
    other = next(suite.cases("planar", made.image, 9))
    one = replace(other, growth=[])
    assert one.differ
    gallery = report.Gallery()
    for shown in (case, one, replace(one, image=255 - one.image)):
        gallery.add(shown)
    assert gallery.cases["planar", "auto"] is one
