"""Camera files: round trips, names, the lenses that a format can't hold, and the documentation."""

import re
import textwrap
from pathlib import Path

import numpy as np
import pytest
from camera_files import FORMATS, HELD, LENSES, SIZE, UNHELD, K, camera, same_camera
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rcdn.errors import FormatError, OutputError
from rcdn.io import (
    camera_format,
    read_camera,
    write_camera,
)
from rcdn.types import Camera


@pytest.mark.parametrize(("kind", "lens"), HELD)
def test_round_trip_recognised_by_content(tmp_path, kind, lens):
    """Whatever the file is called."""
    path = tmp_path / "camera.file"
    write_camera(path, camera(lens), kind)
    same_camera(read_camera(path), camera(lens))
    same_camera(read_camera(path, kind), camera(lens))
    first = path.read_bytes()
    write_camera(path, read_camera(path), kind)
    assert path.read_bytes() == first


@pytest.mark.parametrize(("kind", "lens"), sorted(UNHELD))
def test_a_lens_that_a_format_cannot_hold(tmp_path, kind, lens):
    """The message names formats that can, and they do."""
    with pytest.raises(FormatError, match=r"write (.*)") as caught:
        write_camera(tmp_path / "a", camera(lens), kind)
    assert list(tmp_path.iterdir()) == []
    others = re.findall("|".join(FORMATS), re.search(r"write (.*)", str(caught.value)).group(1))
    assert kind not in others
    assert others == [other for other in FORMATS if (other, lens) in HELD]
    for other in others:
        write_camera(tmp_path / "a", camera(lens), other)


def test_kalibr_names_the_number_that_it_cannot_hold(tmp_path):
    with pytest.raises(FormatError, match=r"k3 = 0\.003; calibrate"):
        write_camera(tmp_path / "a", camera("brown5"), "kalibr")
    without = Camera(K, [-0.1, 0.02, 1e-5, -1e-3, 0], SIZE)
    write_camera(tmp_path / "a", without, "kalibr")
    same_camera(read_camera(tmp_path / "a"), without)


@pytest.mark.parametrize("kind", [k for k in FORMATS if k != "json"])
def test_skew_and_numbers_that_are_not_finite(tmp_path, kind):
    skew = K.copy()
    skew[0, 1] = 0.5
    with pytest.raises(FormatError, match="skew"):
        write_camera(tmp_path / "a", Camera(skew, [], SIZE, "pinhole"), kind)
    with pytest.raises(FormatError, match="finite"):
        write_camera(tmp_path / "a", endless(np.nan), kind)
    write_camera(tmp_path / "a.json", Camera(skew, [], SIZE, "pinhole"))
    np.testing.assert_array_equal(read_camera(tmp_path / "a.json").K, skew)
    with pytest.raises(FormatError, match="finite"):
        write_camera(tmp_path / "b.json", endless(np.inf))


def endless(value):
    """A camera on the way of a solver, whose first coefficient is `value`."""
    start = Camera(K, [0, 0, 0, 0], SIZE, "fisheye")
    return start.with_parameters(np.array([*start.parameters[:4], value, 0, 0, 0]))


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(HELD), st.lists(st.floats(-1e6, 1e6), min_size=8, max_size=8), st.floats(1e-3, 1e9))
def test_every_digit_survives(tmp_path, held, values, focal):
    kind, lens = held
    model, d = LENSES[lens]
    found = Camera(np.diag([focal, 1 / focal, 1]), values[: len(d)], (1, 10**6), model)
    path = tmp_path / "a"
    write_camera(path, found, kind)
    back = read_camera(path)
    n = min(len(back.distortion), len(d))
    np.testing.assert_array_equal(back.distortion[:n], found.distortion[:n])
    assert not back.distortion[n:].any()
    assert not found.distortion[n:].any()
    np.testing.assert_allclose(back.K, found.K, rtol=0 if kind != "colmap" else 1e-15)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("a.yaml", "opencv"),
        ("a.YML", "opencv"),
        ("left_camera_info.yaml", "ros"),
        ("camchain-x.yaml", "kalibr"),
        ("cameras.txt", "colmap"),
        ("a.cameramodel", "mrcal"),
        ("camera_info.json", "json"),
    ],
)
def test_the_format_follows_the_name_unless_it_is_given(tmp_path, name, kind):
    assert camera_format(tmp_path / name) == kind
    assert camera_format(tmp_path / name, "ros") == "ros"
    write_camera(tmp_path / name, camera("brown4"))
    write_camera(tmp_path / "named", camera("brown4"), kind)
    assert (tmp_path / name).read_bytes() == (tmp_path / "named").read_bytes()


def test_names_that_tell_no_format(tmp_path):
    with pytest.raises(FormatError, match=r"which format\?"):
        write_camera(tmp_path / "camera.xml", camera())
    for call in (lambda: camera_format("a", "matlab"), lambda: write_camera(tmp_path / "a", camera(), "matlab")):
        with pytest.raises(FormatError, match="format must be one of opencv, ros"):
            call()
    with pytest.raises(OutputError):
        write_camera(tmp_path, camera(), "ros")
    assert list(tmp_path.iterdir()) == []


FORMATS_PAGE = Path(__file__).parents[2] / "docs" / "formats.md"


def test_documented_examples_are_what_is_written(tmp_path):
    page = FORMATS_PAGE.read_text("utf-8")
    blocks = [textwrap.dedent(b) for b in re.findall(r"(?:^(?: {4}.*)?\n)+", page, re.M) if b.strip()]
    shown = Camera([[812.5, 0, 641.25], [0, 809.75, 355.5], [0, 0, 1]], [-0.1, 0.02, 1e-5, -1e-3], SIZE)
    for kind, found in [
        ("opencv", Camera(shown.K, [*shown.distortion, 0.003], SIZE)),
        ("kalibr", shown),
        ("colmap", shown),
        ("mrcal", shown),
    ]:
        write_camera(tmp_path / "a", found, kind)
        assert (tmp_path / "a").read_text().strip() in [b.strip() for b in blocks], kind
    assert len(blocks) == 4


def test_documented_table_of_formats():
    rows = re.findall(r"^\| `(\w+)` \|.*?\| (pinhole.*?|all.*?) \|", FORMATS_PAGE.read_text("utf-8"), re.M)
    assert [kind for kind, _ in rows] == list(FORMATS)
    for kind, lenses in rows:
        for lens, (model, _) in LENSES.items():
            if lens != "brown5" and "all" not in lenses:
                assert (model in lenses) == ((kind, lens) in HELD), (kind, lens)
