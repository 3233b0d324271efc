"""`python first_board.py`: the first board that an installed rcdn finds, in a picture that it draws,
and the seconds of its import."""

import json
import time

began = time.perf_counter()
import rcdn  # noqa: E402

imported = time.perf_counter() - began

import numpy as np  # noqa: E402

from rcdn import _native  # noqa: E402
from rcdn.synthetic import random_scene, render  # noqa: E402

boards = rcdn.Detector().boards(render(random_scene(np.random.default_rng(1)), samples=2))
if [board.size for board in boards] != [(12, 7)]:
    raise SystemExit(f"one board of 12×7 corners is in the picture, not {boards}")
print(json.dumps({"import": imported, "level": _native.level}))
