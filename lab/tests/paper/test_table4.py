"""Table 4: errors that were put in come out, missing corners flatter nobody,
and the paper's figures are the paper's."""

import functools
import json
from dataclasses import asdict, replace

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from rcdn.errors import ConfigError
from rcdn.io import write_image
from rcdn_lab.calibration import CameraSet, Contestant, protocol
from rcdn_lab.cli.evaluate.table4 import table4 as command
from rcdn_lab.paper import stereo_pair, table4, table4_figures, table4_published, table4_work
from rcdn_lab.paper.table4_figures import Boards, Truth
from rcdn_lab.peers import Grid

SIZE, WIDE = stereo_pair.SIZE, stereo_pair.IMAGE_SIZE
IJ = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1).reshape(-1, 2)
COUNT = 12


@functools.cache
def truths():
    """The truth of both cameras."""
    made = stereo_pair.views(COUNT)
    return [
        Truth(stereo_pair.camera_of(side), np.array([v.T[c] for v in made]), np.array([v.xy[c] for v in made]))
        for c, side in enumerate(stereo_pair.SIDES)
    ]


@pytest.fixture(autouse=True)
def few_splits(monkeypatch):
    """One instead of five: enough for all that is asked here."""
    monkeypatch.setattr(protocol, "SPLITS", 1)


def boards_of(xy, side=0, keep=None, truth=True):
    """Boards of these corners (V, M, 2); `keep` (M,): which of them are there."""
    keep = np.ones(len(IJ), bool) if keep is None else keep
    boards = [(IJ[keep], spots[keep]) for spots in xy]
    return Boards(list(range(len(xy))), boards, WIDE, SIZE, "brown", len(xy), truths()[side] if truth else None)


def noisy(sigma, seed=0, side=0):
    xy = truths()[side].xy
    return xy + np.random.default_rng(seed).normal(0, 1, xy.shape) * np.asarray(sigma)[..., None]


# ---- figures


def test_exact_corners_leave_no_error():
    seen = table4_figures.figures([boards_of(truths()[side].xy, side) for side in (0, 1)])
    assert max(seen.cal, seen.pose, seen.mean, seen.rms, seen.most, seen.model) < 1e-4
    assert max(seen.focal, seen.centre, seen.rotation, seen.translation) < 1e-2
    assert seen.outliers == 0


def test_errors_are_those_of_the_noise_that_was_put_in():
    """Noise of σ an axis: a fit leaves √2·σ·√(1 − unknowns ÷ numbers), held-out poses √2·σ·√(1 − 6 ÷ numbers) and a
    little of the camera's error."""
    sigma = 0.1
    seen = table4_figures.figures([boards_of(noisy(sigma, 1, side), side) for side in (0, 1)])
    length, numbers = sigma * np.sqrt(2), 2 * len(IJ)
    assert seen.cal == pytest.approx(length * np.sqrt(1 - (6 + 9 / (COUNT / 2)) / numbers), rel=0.03)
    assert length * np.sqrt(1 - 6 / numbers) * 0.98 < seen.pose < 1.1 * length
    assert seen.rms == pytest.approx(length, rel=0.03)
    assert seen.mean == pytest.approx(sigma * np.sqrt(np.pi / 2), rel=0.03)
    assert seen.most == pytest.approx(sigma * np.sqrt(-2 * np.log(0.05)), rel=0.05)
    assert 0 < seen.model < 0.6 * length


def test_the_errors_of_cameras_and_poses_grow_with_the_noise_and_are_small():
    fine, rough = (table4_figures.figures([boards_of(noisy(s, 2))]) for s in (0.02, 0.2))
    for name in ("focal", "centre", "rotation", "translation", "model"):
        assert 5 < getattr(rough, name) / getattr(fine, name) < 20
    assert rough.focal < 0.01 * 905
    assert rough.centre < 10
    assert rough.rotation < 1
    assert rough.translation < 0.01


def test_who_drops_its_worst_corners_is_flattered_by_the_reprojection_error_alone():
    """The rim is noisier than the middle: without it the error that one sees is less,
    and the one that one doesn't see is more."""
    rim = (IJ == 0).any(axis=1) | (np.array(SIZE) - 1 == IJ).any(axis=1)
    xy = noisy(np.where(rim, 0.15, 0.1), 3)
    every, some = table4_figures.figures([boards_of(xy)]), table4_figures.figures([boards_of(xy, keep=~rim)])
    assert some.cal < 0.9 * every.cal
    assert some.pose < 0.9 * every.pose
    assert some.model > 1.2 * every.model
    assert np.isnan(some.most)
    assert every.most > 0.1


def test_corners_that_disagree_with_the_others_are_counted_not_left_out():
    xy = noisy(0.1, 6)
    xy[2, 30] += 9
    seen = table4_figures.figures([boards_of(xy)])
    assert seen.outliers == 1
    assert max(seen.cal, seen.pose) > 3 * 0.1 * np.sqrt(2)


def test_the_worst_five_of_a_hundred_corners_may_be_missing_but_count_as_worst():
    xy, keep = noisy(0.1, 4), np.ones(len(IJ), bool)
    gaps = np.linalg.norm(xy - truths()[0].xy, axis=2)
    keep[[7, 11]] = False  # 3.7 %
    _, _, every = table4_figures.corner_errors([boards_of(xy)])
    _, _, fewer = table4_figures.corner_errors([boards_of(xy, keep=keep)])
    rest = np.sort(np.where(keep, gaps, np.inf).ravel())
    assert fewer == pytest.approx(rest[int(np.ceil(0.95 * rest.size)) - 1])
    assert fewer > every


@pytest.mark.parametrize("turn", range(4))
def test_labels_of_a_part_are_brought_home(turn):
    true, size = truths()[0].xy[0], np.array(SIZE)
    part = (IJ >= [2, 1]).all(axis=1) & (size - 1 > IJ).all(axis=1)
    own = IJ[part] @ table4_figures.TURNS[turn].T
    ij = table4_figures.relabelled(own - own.min(axis=0), true[part] + 0.4, true, SIZE)
    np.testing.assert_array_equal(ij, IJ[part])


def test_a_wrong_label_is_a_far_corner():
    xy = truths()[0].xy.copy()
    xy[0, [3, 4]] = xy[0, [4, 3]]
    seen = table4_figures.corner_errors([boards_of(xy)])
    step = np.linalg.norm(truths()[0].xy[0, 3] - truths()[0].xy[0, 4])
    assert seen[0] == pytest.approx(2 * step / truths()[0].xy[..., 0].size)


def test_small_turns_are_exact():
    for degrees in (1e-6, 1e-3, 1.0, 60.0):
        a = np.radians(degrees)
        R = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
        assert table4_figures.angle(R[None])[0] == pytest.approx(degrees, rel=1e-6)


def test_the_place_of_the_cameras_is_judged():
    true = stereo_pair.right_from_left()
    exact = table4_figures.rig_of(*(boards_of(truths()[s].xy, s) for s in (0, 1)), stereo_pair.SPACING, true)
    assert exact.pairs == COUNT
    assert exact.baseline < 1
    assert exact.turn < 1e-4
    few = [replace(boards_of(truths()[s].xy, s), index=[0], boards=[(IJ, truths()[s].xy[0])]) for s in (0, 1)]
    note = table4_figures.rig_of(*few, stereo_pair.SPACING, true).note
    assert note.startswith("no stereo calibration: left camera: there is one view")


# ---- rows


class Kept(dict):
    """A store in memory."""

    def key(self, content, *more):
        return "|".join(map(str, (content, *more)))

    def put(self, key, value):
        self[key] = value


@pytest.fixture
def pair(tmp_path, monkeypatch):
    """Plain files whose first grey values are camera and number, in place of the rendered ones;
    outliers are not looked for."""
    monkeypatch.setattr(table4_figures, "without_outliers", lambda task: task)
    for c, side in enumerate(stereo_pair.SIDES):
        for k in range(COUNT):
            grey = np.full((WIDE[1], WIDE[0]), 9, np.uint8)
            grey[0, :2] = c, k
            write_image(tmp_path / f"{side}{k:04d}.png", grey)
    cameras = tuple(CameraSet(side, f"{side}*.png", SIZE) for side in stereo_pair.SIDES)
    return table4.PaperSet("rendered", table4_published.EYE_TRACKER, cameras, tmp_path, tuple(truths()))


def detector(name, corners):
    """A detector that knows its pictures; `corners`(camera, number): a Grid or None."""

    def find(image, size):
        grid = corners(int(image[0, 0]), int(image[0, 1]))
        return [] if grid is None else [grid]

    return Contestant(name, lambda: find, Kept(), "1")


def simple(name, sigma, seed, misses=(), turned=False):
    xy = [noisy(sigma, [seed, side], side) for side in (0, 1)]
    ij = np.array(SIZE) - 1 - IJ if turned else IJ
    return detector(name, lambda c, k: None if k in misses else Grid(xy[c][k], ij))


def one_camera(pair, **more):
    return replace(pair, **({"cameras": pair.cameras[:1], "truth": pair.truth[:1]} | more))


def test_rows_of_a_set(pair):
    trio = [
        simple("auto", 0.05, 1),
        simple("opencv", 0.1, 2, misses=(3,), turned=True),
        simple("paper", 0.07, 3, range(5)),
    ]
    rows = table4.table(
        [one_camera(pair)], trio, {"boofcv-size": "not installed: pip install it"}, {"gopro": "no folder"}
    )
    assert len({tuple(r) for r in rows}) == 1
    by = {(r["set"], r["on"], r["detector"]): r for r in rows}
    assert [k for k in by if not k[0].startswith("paper: ")] == [
        *(("rendered", "all", n) for n in ("auto", "opencv", "paper")),
        *(("rendered", "common", n) for n in ("auto", "opencv")),
        *(("rendered", "with paper", n) for n in ("auto", "opencv", "paper")),
        ("gopro", "-", "-"), ("-", "-", "boofcv-size"), ("ALL", "common", "auto"), ("ALL", "common", "opencv"),
    ]  # fmt: skip
    every = by["rendered", "all", "opencv"]
    assert (every["whole"], every["pictures"], every["views"], every["corners"]) == (11, 12, 11, 11 * 54)
    assert every["rms"] == pytest.approx(0.1 * np.sqrt(2), rel=0.05)
    assert {by["rendered", "common", n]["views"] for n in ("auto", "opencv")} == {11}
    assert {by["rendered", "with paper", n]["views"] for n in ("auto", "opencv", "paper")} == {7}
    alike = by["rendered", "common", "auto"]
    assert alike["cal ÷ opencv"] == pytest.approx(0.5, rel=0.06)
    assert alike["paper's cal"] == pytest.approx(0.17721 / 0.18952)
    assert alike["cal − paper's"] == pytest.approx(alike["cal ÷ opencv"] - alike["paper's cal"])
    assert by["ALL", "common", "auto"]["pose ÷ opencv"] == pytest.approx(alike["pose ÷ opencv"])
    assert by["-", "-", "boofcv-size"]["note"] == "skipped: not installed: pip install it"
    assert by["gopro", "-", "-"]["note"] == "skipped: no folder"
    assert all(by[k]["cal"] is None for k in (("gopro", "-", "-"), ("-", "-", "boofcv-size")))
    holds = {c.text: c.holds for c in table4_published.claims(rows)}
    assert holds["`auto` has the lowest pose error on rendered"]
    assert holds["`auto` has the highest detection rate on rendered"]
    assert holds["`paper` has the lowest calibration error on rendered"]
    assert holds["`paper` has the highest detection rate on rendered"] is False


def test_the_cameras_of_a_set_count_together_and_again_the_same(pair, monkeypatch):
    calls = []

    def place(left, right, spacing, true):
        calls.append((left.index, right.index))
        return table4_figures.Rig(len(left.index), 5.0, 0.01)

    monkeypatch.setattr(table4, "rig_of", place)
    xy = [noisy(s, [1, c], c) for c, s in enumerate((0.05, 0.15))]
    ours = detector("opencv", lambda c, k: Grid(xy[c][k], IJ))
    rows, again = (table4.table([pair], [ours]) for _ in range(2))
    assert rows == again
    every, alike = (next(r for r in rows if r["set"] == "rendered" and r["on"] == on) for on in ("all", "common"))
    assert every | {"on": "common"} == alike
    assert every["rms"] == pytest.approx(np.sqrt(2 * (0.05**2 + 0.15**2) / 2), rel=0.05)
    assert every["cal"] == pytest.approx(every["rms"], rel=0.1)
    assert (every["pairs"], every["baseline"], every["views"]) == (12, 5.0, 24)
    assert calls == [(list(range(12)), list(range(12)))] * 4


def test_a_breakdown_and_too_few_boards_are_told(pair):
    def broken(c, k):
        raise RuntimeError("no memory")

    rows = table4.table(
        [one_camera(pair)], [simple("auto", 0.05, 1), detector("opencv", broken), simple("geiger", 0.1, 2, range(7))]
    )
    by = {(r["on"], r["detector"]): r for r in rows if r["set"] == "rendered"}
    assert "broke down on 12 pictures (RuntimeError: no memory)" in by["all", "opencv"]["note"]
    assert by["all", "opencv"]["whole"] == 0
    assert by["all", "opencv"]["cal"] is None
    assert "under 6 pictures of a camera" in by["with geiger", "geiger"]["note"]
    assert by["with geiger", "geiger"]["rms"] == pytest.approx(0.1 * np.sqrt(2), rel=0.1)
    with pytest.raises(ConfigError, match="none of them can run here"):
        table4.table([pair], [])


def test_without_truth_there_are_reprojection_errors_only(pair):
    rows = table4.table([one_camera(pair, truth=())], [simple("auto", 0.05, 1)])
    row = next(r for r in rows if r["on"] == "common" and r["set"] == "rendered")
    assert row["cal"] > 0
    assert all(row[k] is None for k in ("mean", "rms", "most", "focal", "model", "baseline", "pairs", "cal ÷ opencv"))


# ---- the paper's


def test_the_papers_figures():
    """Proposed is the lowest of its table in both errors on both sets, and so its ratios to OpenCV are below 1."""
    known = {(p.like, p.method, p.on): p for p in table4_published.PUBLISHED}
    assert len(known) == 14
    for like in (table4_published.EYE_TRACKER, table4_published.WIDE_ANGLE):
        for on in ("all", table4_published.WITH_OCPAD):
            of = [p for p in known.values() if (p.like, p.on) == (like, on)]
            assert min(of, key=lambda p: p.cal).method == min(of, key=lambda p: p.pose).method == "Proposed"
    ratio = table4_published.published_ratio
    assert ratio("eye tracker", "Proposed", "cal") == pytest.approx(0.93505, abs=1e-5)
    assert ratio("eye tracker", "Proposed", "pose") == pytest.approx(0.93971, abs=1e-5)
    assert ratio("wide angle", "Proposed", "cal") == pytest.approx(0.85408, abs=1e-5)
    assert ratio("wide angle", "Proposed", "pose") == pytest.approx(0.88878, abs=1e-5)
    assert ratio("ALL", "Proposed", "cal") == pytest.approx(np.sqrt(0.93505 * 0.85408), abs=1e-5)
    assert ratio("eye tracker", "OCPAD", "cal") is None


def test_the_papers_rows_are_marked():
    rows = [r for r in table4.table([], [simple("auto", 0.05, 1)]) if r["set"].startswith("paper: ")]
    assert len(rows) == 14
    assert all(r["note"].startswith("paper's figure, other data") for r in rows)
    assert {r["detector"] for r in rows if "can't run here" in r["note"]} == {"MATLAB"}
    assert {(r["whole"], r["on"]) for r in rows} == {(100, "all"), (85, "with OCPAD"), (91, "with OCPAD")}


def rows_of(**pose):
    blank = {k: None for k in asdict(table4_figures.Figures())}
    return [
        blank | {"set": "s", "on": on, "detector": name, "cal": 1.0, "pose": value, "whole": 9, "pictures": 9}
        for on in ("all", "common")
        for name, value in pose.items()
    ]


def test_claims_are_a_function_of_the_rows():
    by_text = {c.text: c for c in table4_published.claims(rows_of(auto=0.2, opencv=0.3, geiger=0.1, paper=0.05))}
    assert len(by_text) == 6
    wrong = by_text["`auto` has the lowest pose error on s"]
    assert not wrong.holds
    assert wrong.found == "0.2000; opencv 0.3000, geiger 0.1000"
    assert by_text["`paper` has the lowest pose error on s"].holds
    assert by_text["`auto` has the lowest calibration error on s"].holds  # a tie
    alone = table4_published.claims(rows_of(auto=0.2, paper=0.1))
    assert {c.holds for c in alone} == {None}


# ---- the command


def app():
    out = typer.Typer()
    out.command()(command)
    return out


def test_sets_without_pictures_are_skipped_visibly(tmp_path):
    found, missing = table4.sets_of(table4.NAMES, None)
    assert not found
    assert list(missing) == ["opencv-left-right", "sourishg-stereo1", "rochade-gopro-a", "udacity-wide"]
    assert "--data or RCDN_DATA" in missing["udacity-wide"]
    write_image(tmp_path / "udacity-wide-gopro" / "a.png", np.zeros((4, 4), np.uint8))
    found, missing = table4.sets_of([*table4.NAMES, "lens:udacity*/*:8x6:brown"], tmp_path)
    assert [s.name for s in found] == ["udacity-wide", "lens"]
    assert [s.like for s in found] == ["wide angle", "eye tracker"]
    assert "no picture matches" in missing["rochade-gopro-a"]
    with pytest.raises(ConfigError, match="no set is called nowhere"):
        table4.sets_of(["nowhere"], tmp_path)


def test_answers_of_all_detectors_are_in_the_store_and_asked_once(tmp_path):
    """So that what took long isn't done again, here or in the next run."""
    path, steps, kept = tmp_path / "a.png", [], Kept()
    write_image(path, np.full((60, 80), 128, np.uint8))
    for _ in range(2):
        names = ["opencv", "opencv-sb"]
        table4_work.fill([(path, SIZE)], names, lambda _config: "", lambda _salt: kept, 1, lambda *s: steps.append(s))
    assert steps == [(1, 1)] * 2
    assert kept
    assert all(answer["grids"] == [] for answer in kept.values())


@pytest.fixture
def small(monkeypatch):
    """Cameras of half the width, whose pictures are quickly rendered, and no stereo calibration."""
    half = {s: (f / 2, (x / 2, y / 2), lens) for s, (f, (x, y), lens) in stereo_pair.LENSES.items()}
    for name, value in {"LENSES": half, "IMAGE_SIZE": (640, 360), "PITCH": (16.0, 26.0)}.items():
        monkeypatch.setattr(stereo_pair, name, value)
    monkeypatch.setattr(table4, "rig_of", lambda *_: table4_figures.Rig())


def test_the_command_runs_from_rendering_to_files(tmp_path, small):
    files = {name: tmp_path / f"t.{name}" for name in ("json", "csv", "md")}
    given = ["--set", "rendered", "--detectors", "opencv-sb", "--views", "12", "--workers", "1"]
    given += ["--cache", str(tmp_path / "cache"), "--json", str(files["json"]), "--csv", str(files["csv"])]
    given += ["--markdown", str(files["md"]), "--pictures", str(tmp_path / "pictures")]
    done = CliRunner().invoke(app(), given)
    assert done.exit_code == 0, done.output
    record = json.loads(files["json"].read_text())
    row = record["rows"][0]
    assert (row["set"], row["on"], row["detector"], row["pictures"]) == ("rendered", "all", "opencv-sb", 24)
    assert row["rms"] < 1
    assert row["cal"] < 1
    assert record["settings"]["rendered views"] == 12
    assert "paper's figure, other data" in files["md"].read_text()
    assert len(files["csv"].read_text().splitlines()) == len(record["rows"]) + 1
    assert len(list((tmp_path / "pictures").glob("*.png"))) == 24
    assert len(list((tmp_path / "cache").rglob("*.json"))) == 24
    again = CliRunner().invoke(app(), given)
    assert isinstance(again.exception, ConfigError)
