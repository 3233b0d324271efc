"""`rcdn report` of a rig's JSON: every number comes back, and the page is the one that `--report` wrote."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_rig_report import found
from typer.testing import CliRunner

from rcdn.batch.pictures import Pictures
from rcdn.cli import app
from rcdn.errors import FormatError
from rcdn.io import read_rig_calibration, write_rig_calibration
from rcdn.report.calibration import write_rig_report
from rcdn.types import FixedBoard, MissingLink

PLACE = np.eye(4)
PLACE[:3, 3] = (0.1, -0.02, 0.3)


def whole():
    """A rig with all that a file can hold."""
    rig = found()
    boards = (FixedBoard(7, "one", 7, np.eye(4), np.zeros((6, 6))), FixedBoard(8, "two", 7, PLACE, 1e-6 * np.eye(6)))
    return replace(
        rig, links=(MissingLink("c<0>", "c<1>", "a", "b", True),), thin=("c<1>",), corrected=("c<1>",),
        fixed_boards=boards
    )  # fmt: skip


def test_a_written_rig_is_read_back_in_every_number(tmp_path):
    write_rig_calibration(tmp_path / "rig.json", whole())
    again = read_rig_calibration(tmp_path / "rig.json")
    write_rig_calibration(tmp_path / "again.json", again)
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "rig.json").read_bytes()
    assert again.fixed_boards[1].T_first_board == pytest.approx(PLACE)
    assert again.pairs == whole().pairs
    assert again.boards.keys() == whole().boards.keys()


def test_the_page_of_the_file_is_that_of_the_calibration(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where the photographs would be: of others a note says that they are left out
    rig = whole()
    shown = {name: Pictures(v.name for v in camera.views) for name, camera in rig.cameras.items()}
    write_rig_report(tmp_path / "first.html", rig, shown)
    write_rig_calibration(tmp_path / "rig.json", whole())
    result = CliRunner().invoke(app, ["report", str(tmp_path / "rig.json"), "-o", str(tmp_path / "page.html")])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "page.html").read_bytes() == (tmp_path / "first.html").read_bytes()
    assert "Boards fixed to each other" in (tmp_path / "page.html").read_text("utf-8")


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("thin", "c", "thin must be a list of names"),
        ("pairs", [{"first": "a"}], r"pairs\[0\]: 'second'"),
        ("shifts", [], "'shifts' must be an object"),
        ("fixed_boards", [{"target": 1}], r"fixed_boards\[0\]"),
        ("kind", "camera", "holds 'camera', not 'rig'"),
    ],
)
def test_a_damaged_file_is_refused_by_the_field(tmp_path, key, value, text):
    path = Path(tmp_path / "rig.json")
    write_rig_calibration(path, whole())
    path.write_text(json.dumps({**json.loads(path.read_text()), key: value}))
    with pytest.raises(FormatError, match=text):
        read_rig_calibration(path)
