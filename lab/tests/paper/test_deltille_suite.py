"""`rcdn evaluate deltille`: what its rows count, on boards of which everything is known,
and the command on a few pictures."""

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from rcdn.synthetic import DELTILLE, random_scene, truth
from rcdn.types import Board
from rcdn_lab.cli.evaluate.deltille import deltille
from rcdn_lab.paper import deltille as suite


def as_found(scene, keep=slice(None), shift=(2, -1)):
    """The truth as a board, labels moved."""
    known = truth(scene)[0]
    index = np.flatnonzero(known.visible)[keep]
    zero = np.zeros(len(index))
    ij = known.ij[index] + shift
    if scene.boards[0].swap != scene.sensor.invert:
        ij = np.stack([-ij[:, 1], ij[:, 0] + ij[:, 1]], axis=1)
    size = (scene.width, scene.height)
    return Board(known.xy[index], ij, size, zero, zero, "ambiguous_120", pattern="deltille")


@pytest.mark.parametrize("seed", range(4))
def test_the_truth_scores_full_and_errors_are_counted(seed):
    scene = random_scene(np.random.default_rng(seed), DELTILLE)
    found = as_found(scene)
    n = len(found)
    assert suite.score(scene, [found]) == (n, n, 0, 0, 1, n, n, 0.0)
    assert suite.score(scene, []) == (n, 0, 0, 0, 0, n, 0, 0.0)
    locatable = np.arange(len(truth(scene)[0].xy)) % 2 == 0
    some = int(locatable[truth(scene)[0].visible].sum())
    assert suite.score(scene, [found], locatable)[4:7] == (1, some, some)
    assert suite.score(scene, [as_found(scene, slice(5, None))])[:5] == (n, n - 5, 0, 0, 0)
    moved = Board(found.xy + [[50.0, 50.0]] * (np.arange(n) < 1)[:, None], found.ij, found.image_size,
                  found.response, found.status, found.orientation, pattern="deltille")  # fmt: skip
    assert suite.score(scene, [moved]).false <= 1
    assert suite.score(scene, [moved]).found >= n - 1
    ij = found.ij.copy()
    ij[[0, 1]] = ij[[1, 0]]
    mixed = Board(found.xy, ij, found.image_size, found.response, found.status, found.orientation, pattern="deltille")
    assert suite.score(scene, [mixed])[3:5] == (2, 0)


def test_views_show_the_whole_board_to_one_camera():
    cameras = {suite.view_scene(k).camera.K.tobytes() for k in range(6)}
    assert len(cameras) == 1
    for k in range(6):
        scene = suite.view_scene(k)
        assert truth(scene)[0].visible.sum() == 90
        assert scene.sensor.noise == suite.NOISE
    assert suite.view_scene(2) == suite.view_scene(2)


def test_claims_say_what_the_figures_say():
    good = ({"recall": 0.995, "wrong labels": 0}, {"false boards": 0}, [], {"cal": 0.1, "pose": 0.5})
    held = {claim.text: claim.holds for claim in suite.claims(*good)}
    assert list(held.values()) == [True, False, True, True, True, None]
    bad = ({"recall": 0.9, "wrong labels": 1}, {"false boards": 2}, [{"boards": 0}], {"cal": 0.4, "pose": 0.1})
    assert [claim.holds for claim in suite.claims(*bad)] == [False, True, False, False, False, False]


def test_without_pictures_there_are_no_rows(tmp_path):
    assert suite.real(None) == []
    assert suite.real(tmp_path) == []


def test_the_command(tmp_path):
    app = typer.Typer()
    app.command()(deltille)
    done = CliRunner().invoke(app, ["--count", "1", "--views", "8", "--json", str(tmp_path / "d.json")])
    assert done.exit_code == 0, done.output
    assert "0.3431" in done.stdout
    assert "skipped: the real pictures" in done.stdout
    assert "doesn't hold" not in done.stdout
    assert (tmp_path / "d.json").stat().st_size > 300
