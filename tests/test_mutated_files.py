"""Files made bad in every way are read or refused: any change gives a result or an RcdnError, and never a warning."""

import hashlib
import json
import random
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import rcdn
from mutations import as_json, damaged_bytes, damaged_text, mutated
from rcdn import Board, Camera, Corners, DetectorConfig, RcdnError, estimate_pose
from rcdn.calibration.comparison import compare
from rcdn.corners.response import load_model
from rcdn.io import (
    ImageResult,
    read_calibration,
    read_cameras,
    read_detections,
    read_vnl_boards,
    write_calibration,
    write_camera,
    write_detections,
    write_vnl,
)
from rcdn.synthetic import render, scene_from_json, truth

sys.path += [str(Path(__file__).parent / name) for name in ("cameras", "synthetic")]
from camera_files import HELD, camera
from test_scene import FULL

from test_calibration_files import calibration

SEEDS = st.integers(0, 2**32)
WEIGHTS = Path(rcdn.__file__).parent / "weights"
many = settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
some = settings(many, max_examples=60)


def tried(function, *arguments):
    """What the function gives; None if it refuses."""
    try:
        return function(*arguments)
    except RcdnError:
        return None


def put(path, text):
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    return path


def detected():
    ij = np.array([(i, j) for j in range(3) for i in range(4)])
    xy = ij * 40.3 + [100, 80] + ij[:, :1] * ij[:, 1:] * [0.7, 0.3]
    board = Board(xy, ij, (640, 480), np.ones(12), np.zeros(12), "unique", np.full(12, 0.05))
    return [ImageResult("a.png", 640, 480, Corners(xy, board.response, board.status, np.ones((12, 2))), (board,))]


@some
@given(SEEDS)
def test_detections(tmp_path, seed):
    rng, path, out = random.Random(seed), tmp_path / "a.json", tmp_path / "b"
    write_detections(path, detected(), [("b.png", "bad")])
    put(path, as_json(mutated(json.loads(path.read_text()), rng), rng))
    if (found := tried(read_detections, path)) is None:
        return
    tried(write_detections, out, *found)
    tried(write_vnl, out, found[0])
    lens = Camera([[600, 0, 320], [0, 600, 240], [0, 0, 1]], [], (640, 480), "pinhole")
    for board in [board for image in found[0] for board in image.boards]:
        tried(estimate_pose, board, lens, 0.025)


@many
@given(SEEDS)
def test_vnl(tmp_path, seed):
    path = tmp_path / "a.vnl"
    write_vnl(path, detected())
    put(path, damaged_text(path.read_text(), random.Random(seed)))
    tried(read_vnl_boards, path, None, (640, 480))


@many
@given(st.sampled_from(HELD), SEEDS)
def test_cameras(tmp_path, held, seed):
    rng, path, (kind, lens) = random.Random(seed), tmp_path / "a", held
    write_camera(path, camera(lens), kind)
    text = path.read_text()
    put(path, as_json(mutated(json.loads(text), rng), rng) if kind == "json" else damaged_text(text, rng))
    for found in (tried(read_cameras, path, rng.choice((None, kind))) or {}).values():
        tried(write_camera, path, found, "json")
        if rng.random() < 0.2:
            tried(compare, found, camera(lens))


@some
@given(SEEDS)
def test_calibrations(tmp_path, seed):
    rng, path = random.Random(seed), tmp_path / "a.json"
    write_calibration(path, calibration())
    put(path, as_json(mutated(json.loads(path.read_text()), rng), rng))
    if (found := tried(read_calibration, path)) is not None:
        assert np.isfinite(found.rms) or np.isnan(found.rms)
        write_calibration(path, found)


@settings(many, max_examples=200)
@given(SEEDS)
def test_scenes(seed):
    rng = random.Random(seed)
    scene = tried(scene_from_json, as_json(mutated(json.loads(FULL.to_json()), rng), rng))
    if scene is not None and scene.width * scene.height <= 10_000:
        truth(scene)
        assert render(scene, samples=1).shape == (scene.height, scene.width)


@settings(many, max_examples=300)
@given(st.sampled_from([DetectorConfig.auto(), DetectorConfig.paper()]), SEEDS)
def test_settings(config, seed):
    rng = random.Random(seed)
    text = as_json(mutated(json.loads(config.to_json()), rng), rng)
    tried(DetectorConfig.from_json, text)


@some
@given(st.sampled_from(["rcdn_q", "rcdn_f"]), SEEDS)
def test_networks(tmp_path, name, seed):
    rng = random.Random(seed)
    data, facts = (WEIGHTS / f"{name}.onnx").read_bytes(), json.loads((WEIGHTS / f"{name}.json").read_text())
    facts = {key: facts[key] for key in ("sha256", "margins", "cell", "normalisation", "ranges") if key in facts}
    if rng.random() < 0.5:
        data = damaged_bytes(data, rng)
    else:
        facts = mutated(facts, rng)
    if isinstance(facts, dict):
        facts["sha256"] = hashlib.sha256(data).hexdigest()
    path = tmp_path / "a.onnx"
    path.write_bytes(data)
    put(path.with_suffix(".json"), json.dumps(facts))
    if (model := tried(load_model, str(path))) is None:
        return
    response = tried(model, np.arange(40 * 40, dtype=np.uint8).reshape(40, 40), 1)
    assert response is None or np.isfinite(response).all()


@some
@given(SEEDS)
def test_training_configurations(tmp_path, seed):
    pytest.importorskip("torch")
    from rcdn.training.config import read_config

    text = (Path(__file__).parents[1] / "configs" / "train_q.toml").read_text()
    tried(read_config, put(tmp_path / "a.toml", damaged_text(text, random.Random(seed))))
