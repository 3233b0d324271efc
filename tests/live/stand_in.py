"""A guide as simple as can be, which takes every board that is still and elsewhere than those before,
and what else a session needs."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from rcdn.live.session import Tools, Written
from rcdn.types import Board

STILL, ELSEWHERE, ENOUGH = 2.0, 40.0, 5
"""px between frames; px from what was taken; pictures"""


class Guide:
    def __init__(self, image_size, spacing, enough=ENOUGH):
        self.image_size, self.spacing, self.enough = image_size, spacing, enough
        self.boards, self.last, self.still = {}, None, 0

    def look(self, board, time, grey=None):
        if board is None:
            self.last = None
            return answer("No board is seen.", "Hold the board in front of the camera.")
        middle = board.xy.mean(axis=0)
        moved = np.inf if self.last is None else np.linalg.norm(middle - self.last)
        self.last, self.still = middle, self.still + 1 if moved < STILL else 0
        if self.still < 3:
            return answer("Hold the board still.", "Hold still.")
        new = all(np.linalg.norm(b.xy.mean(axis=0) - middle) > ELSEWHERE for b in self.boards.values())
        arrow = np.stack([middle, np.array(self.image_size) / 2])
        return answer("", "Hold still." if new else "Move the board to the left.", new, 0.9 if new else 0.4, arrow)

    def add(self, board, name):
        self.boards = {**self.boards, name: board}  # another thread may be looking
        return self.progress

    def add_all(self, boards):
        self.boards = {**self.boards, **boards}
        return self.progress

    def remove(self, name):
        self.boards = {k: b for k, b in self.boards.items() if k != name}
        return self.progress

    @property
    def progress(self):
        width, height = self.image_size
        box = np.array([[0.3, 0.3], [0.7, 0.25], [0.7, 0.75], [0.3, 0.7]]) * [width, height]
        worst = 1 / len(self.boards) if len(self.boards) > 1 else np.inf
        values = None if worst == np.inf else np.linspace(0.05, worst, 48).reshape(6, 8)
        done = len(self.boards) >= self.enough
        return SimpleNamespace(
            views=tuple(self.boards), wanted=SimpleNamespace(outline=box, size=(4, 3)),
            sentence="Hold the board as shown.", worst=worst, target=0.1, map=values, done=done,
        )  # fmt: skip


def answer(refused, hint, take=False, fit=0.0, arrow=None):
    return SimpleNamespace(refused=refused, hint=hint, take=take, fit=fit, arrow=arrow)


def board(xy, image_size=(640, 480)):
    """A board of 4 × 3 corners, moved by `xy` px."""
    ij = np.stack(np.meshgrid(np.arange(4), np.arange(3)), axis=-1).reshape(-1, 2)
    return Board(ij * 40.0 + xy, ij, image_size, np.ones(12), np.zeros(12), "unique")


def write(folder, names, boards, settings):
    (folder / "camera.yaml").write_text("%YAML:1.0\n")
    (folder / "report.html").write_text("<p>report</p>")
    return Written((folder / "camera.yaml", folder / "report.html"), "good", ("good: use it",))


def tools(found=None, **other):
    """What a session works with: `found` in every picture, whatever it shows (None: rcdn's own detector)."""
    if found is not None:
        parts = {"follow": lambda grey, close: found(), "detect": lambda grey: [b for b in [found()] if b is not None]}
    else:
        from rcdn import Detector, DetectorConfig

        detector = Detector(DetectorConfig(threads=1))
        parts = {"follow": lambda g, close: max(detector.boards(g), key=len, default=None), "detect": detector.boards}
    return Tools(**{"make_guide": Guide, "write": write, **parts, **other})
