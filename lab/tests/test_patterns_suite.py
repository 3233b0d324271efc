"""`rcdn evaluate patterns`: pictures with known answers, counts, and the command."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from rcdn.cli import app
from rcdn_lab import patterns as suite

TRUE = np.array([[x, y] for y in range(100, 400, 50) for x in range(100, 550, 50)], float)


def test_a_whole_board_wrong_corners_and_boards_beside_it_are_counted():
    assert suite.behind([TRUE[::-1] + 1], TRUE) == suite.Count(behind=1, whole=1)
    assert suite.behind([], TRUE) == suite.Count(behind=1)
    assert suite.behind([TRUE[1:]], TRUE) == suite.Count(behind=1)
    off = np.where(np.arange(54)[:, None] < 3, TRUE + 2, TRUE)
    assert suite.behind([off], TRUE) == suite.Count(behind=1, wrong=3)
    assert suite.behind([TRUE, TRUE + 25], TRUE) == suite.Count(behind=1, whole=1, beside=1)


@pytest.mark.parametrize("kind", suite.KINDS)
def test_pictures_are_the_same_again_and_differ_from_each_other(kind):
    image, truth = suite.picture(kind, 3, board=False)
    assert image.shape == (720, 960)
    assert image.dtype == np.uint8
    assert len(truth) == 0
    assert image.std() > 5
    assert np.array_equal(image, suite.picture(kind, 3, board=False)[0])
    assert not np.array_equal(image, suite.picture(kind, 5, board=False)[0])


def test_the_board_is_where_its_corners_are():
    """Around a corner, opposite squares are alike and neighbouring ones are not."""
    image, truth = suite.picture("corrugated", 4, board=True)
    grid = truth.reshape(6, 9, 2)
    between = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    x, y = np.rint(between).astype(int).T
    dark = (image[y, x] < 135).T
    i, j = np.indices(dark.T.shape)
    assert (dark == ((i + j) % 2 == (0 if dark[0, 0] else 1)).T).all()


def test_the_command_writes_a_row_for_each_pattern_and_one_over_all(tmp_path, monkeypatch):
    monkeypatch.setattr(suite, "KINDS", {name: suite.KINDS[name] for name in ("corrugated", "dots")})
    result = CliRunner().invoke(
        app, ["evaluate", "patterns", "--count", "2", "--workers", "1", "--json", str(tmp_path / "p.json")]
    )
    assert result.exit_code == 0, result.output
    written = json.loads((tmp_path / "p.json").read_text())
    assert [row["pattern"] for row in written["rows"]] == ["corrugated", "dots", "all"]
    assert written["rows"][-1]["alone"] == written["rows"][-1]["behind a board"] == 4
    assert written["rows"][-1]["whole"] == 4
    assert written["rows"][-1]["false board"] == 0
    assert "false beside" in result.stdout
