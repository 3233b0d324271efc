"""The figures of the docs come from these: small runs with known answers."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from rcdn.cli import app
from rcdn.evaluation import hard, scenes


def test_doubtful_corners_are_neither_right_nor_wrong():
    found = np.array([[10.0, 10], [50, 50], [90, 90]])
    kept = scenes._without(found, np.array([[52.0, 50], [91, 90]]), np.array([[90.0, 91]]))
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
