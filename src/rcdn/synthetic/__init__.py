"""Rendered checkerboard scenes with exact ground truth: one renderer for training, tests, evaluation and docs."""

from rcdn.synthetic.crops import random_crop
from rcdn.synthetic.render import render, truth
from rcdn.synthetic.sample import (
    DELTILLE,
    DELTILLE_TRAINING,
    HARD,
    ORDINARY,
    PRESETS,
    TRAINING,
    Ranges,
    camera_view,
    random_scene,
)
from rcdn.synthetic.scene import Background, Bend, BoardSpec, BoardTruth, Cover, Light, Scene, Sensor
from rcdn.synthetic.scene_text import scene_from_json

__all__ = [
    "DELTILLE", "DELTILLE_TRAINING", "HARD", "ORDINARY", "PRESETS", "TRAINING", "Background", "Bend", "BoardSpec",
    "BoardTruth", "Cover", "Light", "Ranges", "Scene", "Sensor", "camera_view", "random_crop", "random_scene", "render",
    "scene_from_json", "truth",
]  # fmt: skip
