"""Scenes as values: JSON there and back, and what isn't a scene."""

import json

import numpy as np
import pytest

from rcdn.errors import ConfigError
from rcdn.synthetic import HARD, Background, Bend, BoardSpec, Cover, Light, Scene, Sensor, random_scene, scene_from_json

FULL = Scene(
    64, 48, 50.0, (31.5, 23.5), "brown", (-0.1, 0.01, 0.0, 0.001, 0.0),
    boards=(
        BoardSpec(4, 5, (0.1, 0.2, 0.3), (0.0, 1.0, 9.0), bend=Bend(0.1), painted=((1, 2, 0.5), (0, 0, 1.0))),
        BoardSpec(3, 3, (0.0, 0.0, 0.0), (0.0, 0.0, 5.0), coded=4, swap=True),
    ),
    covers=(Cover(1, 2, 3, 4, 5, square=True),),
    light=Light(0.1, shadows=(Cover(0, 0, 1, 1, 2),), glares=((1.0, 2.0, 3.0, 0.4),)),
    sensor=Sensor(jpeg=50, invert=True), background=Background("tiles", 7), seed=9,
)  # fmt: skip


def test_json_there_and_back():
    again = scene_from_json(FULL.to_json())
    assert again == FULL
    assert isinstance(again.boards[0].bend, Bend)
    assert isinstance(again.light.shadows[0], Cover)
    assert hash(again) == hash(FULL)  # tuples all the way down
    for seed in range(40):
        scene = random_scene(np.random.default_rng(seed), HARD)
        assert scene_from_json(scene.to_json()) == scene


def changed(path, value):
    plain = json.loads(FULL.to_json())
    inner = plain
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return json.dumps(plain)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not a scene"),
        ("[]", "scene must be an object"),
        ("{}", "missing"),
        (changed(["depth"], 1), "depth"),
        (changed(["boards", 0, "colour"], 1), "colour"),
        (changed(["boards"], [3]), "boards.0. must be an object"),
        (changed(["light"], {"gz": 1}), "gz"),
    ],
)
def test_anything_else_is_refused(text, words):
    with pytest.raises(ConfigError, match=words):
        scene_from_json(text)


def test_camera_of_a_scene():
    camera = FULL.camera
    assert camera.K.tolist() == [[50, 0, 31.5], [0, 50, 23.5], [0, 0, 1]]
    assert camera.image_size == (64, 48)
    assert camera.model == "brown"
    assert len(camera.distortion) == 5
