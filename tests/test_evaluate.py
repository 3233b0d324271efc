"""The figures of the docs come from these: small runs with known answers."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from rcdn.cli import app
from rcdn.corners.response import load_model
from rcdn.io import ImageResult, write_detections
from rcdn.metrics import counted
from rcdn.types import Board, Corners
from rcdn_lab import detections, hard, scenes
from rcdn_lab.weights import weights_of


def test_doubtful_corners_are_neither_right_nor_wrong():
    found = np.array([[10.0, 10], [50, 50], [90, 90]])
    kept = counted(found, np.array([[90.0, 91]]), np.array([[52.0, 50], [91, 90]]), scenes.RADIUS, scenes.BLIND)
    np.testing.assert_array_equal(kept, found[[0, 2]])


def test_rows_add_up():
    """10 detections: 9 true by the paper's reading, 8 one to one, of 16 corners."""
    row = scenes._row("x", np.array([10, 9, 8, 16, 3, 2.0]), 5)
    assert (row["precision"], row["precision one-to-one"], row["recall"]) == (0.9, 0.8, 0.5)
    assert (row["whole pictures"], row["mean error px"]) == ("3/5", 0.25)


def test_scenes_from_the_command_line(tmp_path):
    out = tmp_path / "scenes.json"
    result = CliRunner().invoke(app, ["evaluate", "scenes", "--count", "3", "--json", str(out)])
    assert result.exit_code == 0, result.output
    record = json.loads(out.read_text())
    assert record["settings"]["count"] == 3
    assert {"commit", "date", "platform", "versions"} <= set(record["provenance"])
    by_name = {row["detector"]: row for row in record["rows"]}
    assert list(by_name) == list(scenes.rows())
    assert by_name["auto"]["recall"] > 0.98
    assert by_name["paper, adaptive"]["recall"] > 0.98
    assert by_name["paper, 0.5"]["recall"] >= by_name["paper, adaptive"]["recall"]  # a lower threshold loses nothing
    assert by_name["paper, 0.5"]["precision"] <= by_name["paper, adaptive"]["precision"]


@pytest.fixture
def few_crops(monkeypatch):
    crops = hard.validation_set.__wrapped__(40)
    monkeypatch.setattr(hard, "validation_set", lambda: crops)


@pytest.mark.usefixtures("few_crops")
def test_hard_crops():
    auto, paper = hard.table()
    assert auto["architecture"] == "Q"
    assert paper["architecture"] == "F"
    assert auto["f1"] > 0.85
    assert auto["f1"] > paper["f1"]


LATTICE = np.array([[i, j] for j in range(3) for i in range(4)])


def picture(path, xy, ij):
    """One board of the corners `xy` with labels `ij`, none if there are none; the raw corners are the same."""
    n = len(xy)
    corners = Corners(xy, np.ones(n), np.zeros(n))
    board = Board(xy, ij, (200, 200), np.ones(n), np.zeros(n), "unique")
    return ImageResult(path, 200, 200, corners, (board,) if n else ())


def scored(tmp_path, **found):
    """The row ALL for pictures `a`… whose truth is the lattice, `empty` without a board, and `open`,
    which nobody settled."""
    truth = (LATTICE * 20 + 50.0).tolist()
    known = {
        f"{k}.png": {"xy": truth, "ordered": True, "ignore": [[150, 150]]} for k in found if k not in ("empty", "open")
    }
    known |= {"empty.png": {"xy": [], "ordered": False}, "open.png": {"xy": None, "ordered": False}}
    (tmp_path / "t.json").write_text(json.dumps({"s": {"board": [4, 3], "exhaustive": True, "images": known}}))
    results = [
        picture(f"/somewhere/s/{k}.png", np.array(xy, float).reshape(-1, 2), ij) for k, (xy, ij) in found.items()
    ]
    write_detections(tmp_path / "d.json", results)
    return detections.table(tmp_path / "d.json", tmp_path / "t.json")[-1]


def test_scores_of_known_answers(tmp_path):
    xy = LATTICE * 20 + 50.0
    swapped = LATTICE.copy()
    swapped[[0, 1]] = swapped[[1, 0]]
    turned = np.column_stack([-LATTICE[:, 1] + 7, LATTICE[:, 0]])
    none = (np.zeros((0, 2)), np.zeros((0, 2)))
    row = scored(
        tmp_path,
        good=(xy + 1, LATTICE),
        turned=(xy, turned),
        ignored=(np.vstack([xy, [[151, 150]]]), np.vstack([LATTICE, [[9, 9]]])),
        extra=(np.vstack([xy, [[190, 30]]]), np.vstack([LATTICE, [[9, 9]]])),
        partial=(xy[:8], LATTICE[:8]),
        swapped=(xy, swapped),
        missing=none,
        empty=(xy, LATTICE),
        open=(xy, LATTICE),
    )
    assert row["whole"] == "3/7"
    assert row["recall"] == pytest.approx((5 * 12 + 8) / 84, abs=1e-4)
    assert (row["wrong"], row["mislabelled"]) == (1, 1)
    assert (row["open"], row["alarms"]) == ("1/1", "1/1")


def test_truth_that_is_none_is_told(tmp_path):
    write_detections(tmp_path / "d.json", [])
    (tmp_path / "t.json").write_text("[1, 2]")
    result = CliRunner().invoke(app, ["evaluate", "detections", str(tmp_path / "d.json"), str(tmp_path / "t.json")])
    assert result.exit_code == 1
    assert "t.json" in result.stderr


def test_weights_are_named_by_preset():
    """Peers have none; each preset's are those of the file that it loads."""
    found = weights_of(["opencv", "paper", "auto"])
    assert found == {name: load_model(name).facts["sha256"] for name in ("paper", "auto")}
