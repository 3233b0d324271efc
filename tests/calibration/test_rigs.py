"""Many cameras: known rigs from what neighbours share, cut graphs, wrong moments, cameras out of step."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rcdn.batch.moments import moments_of
from rcdn.batch.rig_runs import _against, rig_lines
from rcdn.calibration import calibrate, calibrate_rig
from rcdn.calibration.rig import _of_one_make
from rcdn.calibration.rig_start import Edge, averaged, components_of, tree
from rcdn.errors import CalibrationError, ConfigError
from rcdn.geometry import rotation
from rcdn.io import read_rig, write_rig_calibration
from rcdn.types import Reason, Verdict
from rcdn_lab.camera_scenes import SPACING
from rcdn_lab.rig_scenes import chain, row

pytestmark = pytest.mark.xdist_group("rigs")  # one rig that many of them look at
SCENE = row([0.3, 0.3], ("pinhole", "fisheye"))
MODELS = {"c0": "pinhole", "c1": "fisheye", "c2": "pinhole"}


@pytest.fixture(scope="module")
def seen():
    return SCENE.views(np.random.default_rng(1), chain(3, 3))


@pytest.fixture(scope="module")
def found(seen):
    boards, moments = seen
    return calibrate_rig(boards, SPACING, moments=moments, model=MODELS)


def truth(scene, name, first="c0"):
    return scene.places[name] @ np.linalg.inv(scene.places[first])


def gap(T, U):
    """The small motion (6,) after T that gives U."""
    D = U @ np.linalg.inv(T)
    return np.concatenate([Rotation.from_matrix(D[:3, :3]).as_rotvec(), D[:3, 3]])


def places_hold(found, scene):
    for name in found.rig.names[1:]:
        T, cov = found.rig.relative(found.rig.names[0], name)
        error = gap(T, truth(scene, name, found.rig.names[0]))
        assert error @ np.linalg.solve(cov, error) < 6 + 4 * np.sqrt(12)
        assert np.linalg.norm(error[3:]) < 0.01


def test_a_known_rig_of_two_lenses_comes_back_within_its_deviations(found):
    assert found.components == (("c0", "c1", "c2"),)
    assert not found.links
    assert not found.thin
    assert found.rms == pytest.approx(0.2 * np.sqrt(2), rel=0.05)
    places_hold(found, SCENE)


def test_the_covariance_between_any_two_cameras_is_that_of_their_difference(found):
    T, cov = found.rig.relative("c1", "c2")
    error = gap(T, truth(SCENE, "c2", "c1"))
    assert error @ np.linalg.solve(cov, error) < 6 + 4 * np.sqrt(12)
    back, other = found.rig.relative("c2", "c1")
    assert back @ T == pytest.approx(np.eye(4), abs=1e-9)
    assert np.sqrt(np.diag(other))[:3] @ np.ones(3) == pytest.approx(np.sqrt(np.diag(cov))[:3].sum(), rel=0.5)


def test_boards_are_in_the_frame_of_the_first_camera(found, seen):
    for k, when in enumerate(seen[1]["c1"]):
        view = found.cameras["c1"].views[k]
        T = found.rig.poses[1].T_cam_board @ found.boards[when, 0]
        assert view.pose.T_cam_board == pytest.approx(T, abs=1e-9)


def test_views_of_another_moment_are_left_out_and_named(seen):
    boards, moments = seen
    wrong = list(moments["c2"])
    wrong[0], wrong[1] = wrong[1], wrong[0]
    done = calibrate_rig(boards, SPACING, moments={**moments, "c2": wrong}, model=MODELS)
    assert {k for k, v in enumerate(done.cameras["c2"].views) if v.reason} >= {0, 1}
    places_hold(done, SCENE)


def test_a_cut_rig_names_its_parts_and_what_would_join_them(seen):
    boards, moments = seen
    apart = [f"late {m}" for m in moments["c2"]]
    done = calibrate_rig(boards, SPACING, moments={**moments, "c2": apart}, model=MODELS)
    assert done.components == (("c0", "c1"), ("c2",))
    assert done.rig.names == ("c0", "c1")
    (link,) = done.links
    assert link.second == "c2"
    assert not link.same_moment
    assert done.verdict.level == "bad"
    assert "c2" in done.verdict.against[0].sentence


def test_a_camera_that_hangs_on_one_board_is_named(seen):
    boards, moments = seen
    others = {m for name in ("c0", "c1") for m in moments[name]}
    shared = [m for m in moments["c2"] if m in others]
    when = [m if m == shared[0] else f"late {m}" for m in moments["c2"]]
    done = calibrate_rig(boards, SPACING, moments={**moments, "c2": when}, model=MODELS)
    assert done.thin == ("c2",)
    assert any(r.key == "thin" and "c2" in r.sentence for r in done.verdict.against)


def test_nothing_shared_is_an_error(seen):
    boards, moments = seen
    apart = {name: [f"{name} {m}" for m in each] for name, each in moments.items()}
    with pytest.raises(CalibrationError, match="no two cameras"):
        calibrate_rig(boards, SPACING, moments=apart, model=MODELS)
    with pytest.raises(ConfigError, match="two cameras"):
        calibrate_rig({"a": boards["c0"]}, SPACING)


def test_averaging_halves_what_a_tree_lets_add_up():
    rng = np.random.default_rng(0)
    n = 8
    places = [np.eye(4)] + [
        np.block([[rotation(rng.normal(0, 1, 3)), rng.normal(0, 1, (3, 1))], [0, 0, 0, 1]]) for _ in range(n - 1)
    ]
    edges = []
    for a in range(n):
        for b in range(a + 1, n):
            T = places[b] @ np.linalg.inv(places[a])
            T = T.copy()
            T[:3, :3] = rotation(rng.normal(0, 0.01, 3)) @ T[:3, :3]
            T[:3, 3] += rng.normal(0, 0.01, 3)
            edges.append(Edge(a, b, [], T, 5))
    assert components_of(n + 1, edges) == [list(range(n)), [n]]
    first = tree(range(n), edges)
    errors = [
        np.sqrt(np.mean([gap(T[c], places[c]) @ gap(T[c], places[c]) for c in range(n)]))
        for T in (first, averaged(first, edges))
    ]
    assert errors[1] < 0.85 * errors[0]


def test_moments_are_told_by_name_number_or_order():
    assert moments_of([["a/01.png", "a/02.png"], ["b/02.png", "b/01.png"]]) == ([["01", "02"], ["02", "01"]], "name")
    assert moments_of([["l1.png", "l2.png"], ["r1.png", "r2.png"]])[1] == "number"
    assert moments_of([["x.png", "y.png"], ["p.png", "q.png"]]) == ([["0", "1"], ["0", "1"]], "order")
    with pytest.raises(ConfigError, match="2, 1"):
        moments_of([["x.png", "y.png"], ["p.png"]])


def test_the_calibrations_stay_frozen(found):
    assert replace(found, thin=("x",)).thin == ("x",)
    with pytest.raises(AttributeError):
        found.rms = 1.0


def test_the_terminal_names_the_camera_that_is_known_least(found):
    cov = np.zeros((18, 18))
    cov[6:12, 6:12], cov[12:, 12:] = 1e-6 * np.eye(6), 1e-8 * np.eye(6)
    unsure = replace(found, rig=replace(found.rig, covariance=cov))
    (line,) = [text for text in rig_lines(unsure) if "known least" in text]
    assert line.startswith("  known least: c1; hold the board where it and c")


def test_the_terminal_says_once_what_several_cameras_have_in_common():
    def of(name, sentence, action="Tilt it."):
        return Reason(f"{name}.key", "fair", name, 1.0, 0.5, "", f"{name}: {sentence}", action)

    reasons = [of("a", "Flat."), of("b", "Flat."), of("c", "Flatter."), of("b", "Few.", "Take more.")]
    whole = Reason("components", "bad", "", 2.0, 1.0, "", "Boards connect only a – b.", "")
    assert _against([whole, *reasons], ("a", "b", "c")) == [
        "- Boards connect only a – b.",
        "- a, b: Flat. Similarly c. Tilt it.",
        "- b: Few. Take more.",
    ]
    near, far, other = (
        Reason(f"{name}.key", level, name, value, 1.0, "", f"{name}: {value}.", "Tilt it.")
        for name, level, value in (("a", "fair", 2.0), ("b", "fair", 5.0), ("c", "bad", 1.5))
    )
    assert _against([near, far], ("a", "b")) == ["- b: 5.0. Similarly a. Tilt it."]
    assert _against([near, other, far], ("a", "b", "c")) == ["- c: 1.5. Similarly b, a. Tilt it."]
    many = [of("a", f"Fault {k}.", f"Mend {k}.") for k in range(8)]
    assert _against(many, ("a", "b"))[5:] == [
        "- a: Fault 5. Mend 5.",
        "- 2 other recommendations: see the report (--report)",
    ]


def test_the_terminal_names_cameras_outside_the_rig(found):
    """A camera that no board connects to the others is none of the rig's, and has findings, too."""
    alone = {**found.cameras, "apart": next(iter(found.cameras.values()))}
    some = [
        Reason(f"{name}.key", "fair", name, value, 1.0, "", f"{name}: Flat, {value}.", "Tilt it.")
        for name, value in (("c0", 5.0), ("apart", 2.0))
    ]
    lines = rig_lines(replace(found, cameras=alone, verdict=Verdict("fair", tuple(some))))
    assert lines[-1] == "- c0: Flat, 5.0. Similarly apart. Tilt it."


def test_cameras_of_one_make_get_one_lens_model_and_others_keep_theirs():
    scene = row([0.3, 0.3, 0.3], ("brown", "brown", "fisheye"))
    boards, moments = scene.views(np.random.default_rng(2), chain(4, 4))
    chosen = ("rational", "brown", "fisheye", "rational")  # c0, c1 and c3 are alike

    @functools.cache
    def as_model(camera, lens):
        return calibrate(boards[f"c{camera}"], spacing=SPACING, model=lens)

    alone = [as_model(c, lens) for c, lens in enumerate(chosen)]
    sights = [{(m, 0): k for k, m in enumerate(moments[f"c{c}"])} for c in range(4)]
    found = [c.models[0].model for c in _of_one_make(alone, range(4), as_model, sights)]
    assert found == ["brown", "brown", "fisheye", "brown"]
    named = _of_one_make(alone, [1, 2], as_model, sights)
    assert [c.models[0].model for c in named] == list(chosen)


def test_a_model_for_some_cameras_only_is_refused_by_name(seen):
    boards, moments = seen
    with pytest.raises(ConfigError, match="it has none for c1, c2"):
        calibrate_rig(boards, SPACING, moments=moments, model={"c0": "brown"})


def test_a_camera_that_is_given_twice_in_a_rig_is_refused_by_both_names(seen):
    boards, moments = seen
    twice = {**boards, "copy": boards["c1"]}
    again = {**moments, "copy": moments["c1"]}
    with pytest.raises(ConfigError, match="cameras c1 and copy have the same boards, corner by corner"):
        calibrate_rig(twice, SPACING, moments=again, model="pinhole")
    few = {"all": boards["c1"], "some": boards["c1"][1:]}
    with pytest.raises(ConfigError, match="cameras all and some have the same boards"):
        calibrate_rig(few, SPACING, moments={"all": moments["c1"], "some": moments["c1"][1:]}, model="pinhole")


def test_order_pairs_boards_of_cameras_that_have_as_many(seen):
    """Of lists of different lengths one lacks a board somewhere, and from there on all would be paired wrongly."""
    boards, moments = seen
    shared = [m for m in moments["c0"] if m in moments["c1"]]
    pair = {n: [b for b, m in zip(boards[n], moments[n], strict=True) if m in shared] for n in ("c0", "c1")}
    lacking = {"c0": pair["c0"], "c1": [*pair["c1"][:3], *pair["c1"][4:]]}
    n = len(shared)
    message = f"views: c0 has {n} boards, c1 has {n - 1} boards: say at which moment each .* moments={{'c0': "
    with pytest.raises(ConfigError, match=message):
        calibrate_rig(lacking, SPACING, model=MODELS)
    when = {"c0": shared, "c1": [*shared[:3], *shared[4:]]}
    found = calibrate_rig(lacking, SPACING, moments=when, model=MODELS)
    assert len(found.boards) == n
    assert found.pairs[0].shared == found.pairs[0].used == n - 1


def test_the_json_of_a_rigs_calibration_is_read_as_its_rig(found, tmp_path):
    write_rig_calibration(tmp_path / "all.json", found)
    read = read_rig(tmp_path / "all.json")
    assert read.names == found.rig.names
    np.testing.assert_array_equal(read.covariance, found.rig.covariance)
    for one, other in zip(read.poses, found.rig.poses, strict=True):
        np.testing.assert_array_equal(one.T_cam_board, other.T_cam_board)
