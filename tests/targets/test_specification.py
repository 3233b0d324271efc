"""Targets in one word and in files: what is written is read again, Kalibr's files are read, and mistakes are named."""

import string

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from rcdn.errors import ConfigError, FormatError, RcdnError
from rcdn.targets.dictionaries import dictionary_names, family_names
from rcdn.targets.files import read_target, target_text, write_target
from rcdn.targets.specification import FORMS, read_specification, specification
from rcdn.types import AprilGrid, Charuco, Checkerboard, Deltille, Printed, PuzzleBoard, PuzzlePart

SIDE = st.integers(2, 9)
SHARE = st.integers(5, 95).map(lambda n: n / 100)


@st.composite
def charuco(draw):
    name = draw(st.sampled_from([n for n in dictionary_names() if n.startswith("DICT_") and not n.endswith("_50")]))
    rows, few = draw(SIDE), name in ("DICT_APRILTAG_16h5", "DICT_APRILTAG_25h9")
    columns, first = (2, 0) if few else (draw(SIDE), draw(st.integers(0, 20)))
    legacy = rows % 2 == 0 and draw(st.booleans())
    return Charuco(columns, rows, name, draw(SHARE), first, legacy, draw(st.booleans()))


TARGETS = st.one_of(
    charuco(),
    st.builds(
        AprilGrid, st.integers(1, 5), st.integers(1, 5), st.sampled_from(family_names()), SHARE,
        st.sampled_from([1, 2]), st.integers(0, 5),
    ),
    st.builds(PuzzlePart, SIDE, SIDE, st.integers(0, 492), st.integers(0, 492)),
    st.builds(Checkerboard, SIDE, SIDE),
    st.builds(Deltille, SIDE, SIDE),
)  # fmt: skip


@given(TARGETS)
@settings(max_examples=150, deadline=None)
def test_what_a_specification_says_is_read_again(target):
    assert read_specification(specification(target)) == target


@given(target=TARGETS, spacing=st.floats(1e-3, 1.0))
@settings(max_examples=150, deadline=None)
def test_what_a_file_says_is_read_again(tmp_path_factory, target, spacing):
    path = tmp_path_factory.getbasetemp() / "target.yaml"
    write_target(path, Printed(target, spacing))
    again = read_target(path)
    assert again.target == target
    assert again.spacing == spacing
    np.testing.assert_allclose(again.points(), Printed(target, spacing).points(), rtol=1e-8)
    assert read_specification(str(path)) == again


@pytest.mark.parametrize(
    ("text", "target"),
    [
        ("charuco:8x8:DICT_4X4_50:0.75", Charuco(8, 8, "DICT_4X4_50", 0.75)),
        ("charuco:8x8:4x4_50:.75:legacy", Charuco(8, 8, "DICT_4X4_50", 0.75, legacy=True)),
        ("charuco:8×7:DICT_4X4_50:0.75:legacy", Charuco(8, 7, "DICT_4X4_50", 0.75)),  # odd rows: both are one
        (" Charuco:5x7:first=3:inverted:DICT_6X6_250:0.7 ", Charuco(5, 7, "DICT_6X6_250", 0.7, 3, inverted=True)),
        ("aprilgrid:6x6:tag36h11:0.3", AprilGrid(6, 6, "tag36h11", 0.3)),
        ("aprilgrid:6x5", AprilGrid(6, 5, "tag36h11", 0.3)),
        ("aprilgrid:3x4:t25h9:0.2:border=1:first=2", AprilGrid(3, 4, "tag25h9", 0.2, 1, 2)),
        ("puzzleboard", PuzzleBoard()),
        ("puzzleboard:12x9:at=0,100", PuzzlePart(12, 9, 0, 100)),
        ("checkerboard:9x6", Checkerboard(9, 6)),
        ("deltille:9x6", Deltille(9, 6)),
    ],
)
def test_specifications_as_people_write_them(text, target):
    assert read_specification(text) == target


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is no target: give a YAML file"),
        ("charco:8x8", "is no target"),
        ("a" * 5000, "is no target"),
        ("a\0b", "is no target"),
        ("charuco", "a size is missing"),
        ("charuco:8:DICT_4X4_50:0.75", "'8' is no size"),
        ("charuco:8x8", "a dictionary is missing"),
        ("charuco:8x8:DICT_4X4_50", "a marker's share is missing"),
        ("charuco:8x8:DICT_4X4_5:0.75", "take one of DICT_4X4_50"),
        ("charuco:8x8:DICT_4X4_50:75", "marker must lie between 0 and 1"),
        ("charuco:8x8:DICT_4X4_50:x5", "must be a number between 0 and 1"),
        ("charuco:8x8:DICT_4X4_50:0.75:0.3", "'0.3' is one part too many"),
        ("charuco:8x8:DICT_4X4_50:0.75:legcy", "'legcy' has no meaning"),
        ("charuco:8x8:DICT_4X4_50:0.75:legacy=no", "legacy has no value"),
        ("charuco:8x8:DICT_4X4_50:0.75:first=1:first=2", "first is given twice"),
        ("charuco:8x8:DICT_4X4_50:0.75:first=", "whole number"),
        ("charuco:12x12:DICT_4X4_50:0.75", "take DICT_4X4_100"),
        ("aprilgrid:6x6:tag36h12:0.3", "take one of .*tag36h11"),
        ("aprilgrid:6x6:tag36h11:3", "gap must lie between 0 and 1"),
        ("aprilgrid:6x6:tag36h11:0.3:border=4", "1 or 2 bits"),
        ("aprilgrid:6x6:tag36h11:0.3:0.4", "one part too many"),
        ("puzzleboard:9x6:at=3", "at= takes a column and a row"),
        ("puzzleboard:9x6:at=3,500", "first row"),
        ("checkerboard:9x6:3", "one part too many"),
        ("checkerboard:1x6", "at least 2"),
    ],
)
def test_mistakes_are_named_and_the_form_is_shown(text, message):
    with pytest.raises(ConfigError, match=message) as caught:
        read_specification(text)
    kind = text.split(":")[0]
    assert FORMS.get(kind, FORMS["charuco"]) in str(caught.value)


@given(st.text(string.ascii_lowercase + string.digits + ":x=.,_ -", max_size=40), st.sampled_from(["", *FORMS]))
@settings(max_examples=300, deadline=None)
def test_any_other_text_is_one_clear_error(text, kind):
    try:
        target = read_specification(f"{kind}:{text}")
    except RcdnError:
        return
    assert read_specification(specification(target)) == target


APRILGRID = """
target_type: 'aprilgrid' #gridtype
tagCols: 6               #number of apriltags
tagRows: 5               #number of apriltags
tagSize: 0.088           #size of apriltag, edge to edge [m]
tagSpacing: 0.3          #ratio of space between tags to tagSize
"""
CHECKERBOARD = """
target_type: 'checkerboard'
targetCols: 6
targetRows: 7
rowSpacingMeters: 0.06
colSpacingMeters: 0.06
"""


def test_kalibr_s_files_are_read(tmp_path):
    path = tmp_path / "april.yaml"
    path.write_text(APRILGRID)
    assert read_target(path) == Printed(AprilGrid(6, 5, "tag36h11", 0.3), 0.088)
    path.write_text(APRILGRID + "codeOffset: 4\n")
    assert read_target(path).target.first_id == 4
    path.write_text(CHECKERBOARD)
    assert read_target(path) == Printed(Checkerboard(6, 7), 0.06)


@pytest.mark.parametrize("text", [APRILGRID, CHECKERBOARD])
def test_what_kalibr_has_a_form_for_is_written_in_that(tmp_path, text):
    path = tmp_path / "target.yaml"
    path.write_text(text)
    assert yaml.safe_load(target_text(read_target(path))) == yaml.safe_load(text)


def test_lengths_in_files_are_metres():
    record = yaml.safe_load(target_text(Printed(Charuco(5, 7, "DICT_4X4_50", 0.75), 0.04)))
    assert (record["spacing"], record["marker"]) == (0.04, 0.03)
    record = yaml.safe_load(target_text(Printed(AprilGrid(5, 7, "tag36h11", 0.25, border=1), 0.08)))
    assert (record["spacing"], record["gap"]) == (0.08, 0.02)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1, 2]", "not a target"),
        ("kind: rings", "kind must be one of"),
        ("kind: [charuco]", "kind must be one of"),
        ("target_type: circlegrid", "'circlegrid' is not supported"),
        (APRILGRID.replace("6 ", "six"), "tagCols must be a whole number"),
        (APRILGRID.replace("0.3 ", "-1 "), "tagSpacing must be a number above 0"),
        (APRILGRID.replace("tagRows: 5", "#"), "tagRows is missing"),
        (APRILGRID + "tagFamily: x\n", "'tagFamily' is no field"),
        (CHECKERBOARD.replace("colSpacingMeters: 0.06", "colSpacingMeters: 0.05"), "differ"),
        (CHECKERBOARD.replace("rowSpacingMeters: 0.06", ""), "rowSpacingMeters is missing"),
        (
            "kind: charuco\ncolumns: 5\nrows: 7\nspacing: 0.04\nmarker: 0.05\ndictionary: DICT_4X4_50\n",
            "marker must lie",
        ),
        (
            "kind: charuco\ncolumns: 5\nrows: 7\nspacing: 0.04\nmarker: 0.03\ndictionary: 7\n",
            "dictionary must be a name",
        ),
        ("kind: charuco\ncolumns: 5\nrows: 7\nspacing: .nan\nmarker: 0.03\n", "spacing must be a number"),
        (
            "kind: charuco\ncolumns: 5\nrows: 7\nspacing: 0.04\nmarker: 0.03\ndictionary: DICT_4X4_50\nlegacy: 1\n",
            "true or false",
        ),
        ("kind: checkerboard\ncolumns: 5\nrows: {a: 1}\nspacing: 1\n", "rows must be a whole number"),
        ("kind: charuco: x", "not YAML"),
    ],
)  # fmt: skip
def test_files_that_are_no_targets_say_why(tmp_path, text, message):
    path = tmp_path / "target.yaml"
    path.write_text(text)
    with pytest.raises(FormatError, match=message) as caught:
        read_specification(str(path))
    assert str(caught.value).startswith(str(path))


def test_a_file_that_is_missing_is_named(tmp_path):
    with pytest.raises(FormatError, match="no such file"):
        read_specification(str(tmp_path / "nothing.yaml"))
