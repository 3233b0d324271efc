"""Pictures made to cost much: reproducible, of the kinds they say, measured in processes that can't hang."""

import cv2
import numpy as np
import pytest

from rcdn.errors import ConfigError
from rcdn_lab.worst_case import run
from rcdn_lab.worst_case.pictures import pictures

SMALL = "board of 4 × 4 squares in 40 × 40 px"


def test_there_are_many_and_the_same_name_gives_the_same_bytes():
    every = pictures()
    assert len(every) >= 90
    for name in (SMALL, "turned boards of 5 × 5 squares of 8 px, 1 MP", "text, 1 MP", "16-bit noise, 1 MP"):
        assert np.array_equal(every[name](), every[name]())
    assert every["noise, 1,000,000 × 3 px"]().shape == (3, 1_000_000)


def test_a_picture_is_measured_in_its_own_process():
    answer = run.measured(SMALL, 60)
    assert (answer["width"], answer["height"], answer["boards"], answer["corners"]) == (40, 40, 1, 9)
    assert answer["ended"] == "done"
    assert 0 < answer["ms a megapixel"] < 1e5


@pytest.mark.skipif(run.sys.platform == "win32", reason="no limit on CPU time")
def test_what_takes_too_long_is_given_up():
    answer = run.measured("board of 6 px squares, 4 MP", 0.5)
    assert answer["ended"] == "given up after 0.5 s"
    assert answer["ms a megapixel"] == 125


def test_the_table_has_the_photographs_first_and_then_the_slowest(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), np.full((60, 80), 99, np.uint8))
    rows = run.table(tmp_path, [SMALL, "1 × 1 px"])
    assert [row["picture"] for row in rows] == [run.PHOTOGRAPHS, SMALL, "1 × 1 px"]
    assert rows[0]["ratio"] == 1
    assert rows[1]["ratio"] > rows[2]["ratio"]


def test_unknown_names_and_empty_folders_are_refused(tmp_path):
    with pytest.raises(ConfigError, match="no name contains"):
        run.table(tmp_path, ["nothing like that"])
    with pytest.raises(ConfigError, match="there is no picture"):
        run.table(tmp_path, [SMALL])
