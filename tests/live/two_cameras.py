"""Two known cameras side by side, their frames, and somebody who holds the board where both want it."""

from __future__ import annotations

import time

import cv2
import numpy as np
from tests.live.following import MOVES, PATIENCE, RATE
from tests.live.moving_board import IMAGE, Renderer, between, journey, pose, towards

from rcdn.geometry import rotation
from rcdn.types import Camera

RIGHT = Camera(
    np.array([[995.0, 0, 633.0], [0, 994, 366.0], [0, 0, 1]]), np.array([-0.22, 0.06, -0.0005, 0.0007]), IMAGE
)
T_RIGHT_LEFT = np.eye(4)
T_RIGHT_LEFT[:3, :3], T_RIGHT_LEFT[:3, 3] = rotation(np.array([0.01, 0.12, -0.02])), [-0.1, 0.002, 0.006]
BEGIN = pose(0.03, 0, 0.5)
"""T_left_board that both see whole"""


def renderers(noise=5.0):
    """Of the left camera and of the right one."""
    return Renderer(noise), Renderer(noise, RIGHT, 7)


class Hands:
    """A source of pairs of frames: the board goes to the pose that the session wants, not exactly, is held there, and
    put anew if it isn't taken."""

    trouble = ""

    def __init__(self, noise=5.0, moves=MOVES):
        self.session = None
        self._renderers, self._rng = renderers(noise), np.random.default_rng(2)
        self._moves = moves
        self._here, self._way = BEGIN, []
        self._wanted, self._held, self._still = None, None, 0

    def read(self):
        begin = time.monotonic()
        state = self.session.state()
        new = state["wanted"] != self._wanted or self._still > PATIENCE
        if new and not state["busy"] and any(state["wanted"] or ()):
            self._wanted, self._still = state["wanted"], 0
            goal = self._goal(*self._wanted)
            self._way = [between(self._here, goal, (k + 1) / self._moves) for k in range(self._moves)]
        if self._way:
            self._here, self._held = self._way.pop(0), None
        if self._held is None:
            self._held = self.frames(self._here, coarse=bool(self._way))
        time.sleep(max(0.0, 1 / RATE - (time.monotonic() - begin)))
        self._still += not state["busy"]
        return self._held, time.monotonic()

    def _goal(self, left, right):
        goal = np.linalg.inv(T_RIGHT_LEFT) @ towards(right, RIGHT) if left is None else towards(left)
        goal[:3, :3] = rotation(self._rng.normal(0, 0.03, 3)) @ goal[:3, :3]
        goal[:3, 3] += self._rng.normal(0, 0.003, 3)
        return goal

    def frames(self, T, coarse=False):
        """The frames of the left and of the right camera of a board at T_left_board."""
        left, right = self._renderers
        return left.frame(T, coarse=coarse), right.frame(T_RIGHT_LEFT @ T, coarse=coarse)

    def close(self):
        pass


def write_side_by_side(path, poses, noise=4.0, **timing):
    """A video whose frames are those of both cameras side by side, as `moving_board.write_video` writes one."""
    hands, last, data = Hands(noise), None, b""
    with open(path, "wb") as file:
        for T, moves in journey(poses, **timing):
            if moves or last is None or T is not last:
                picture = np.hstack(hands.frames(T, coarse=moves))
                data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 93])[1].tobytes()
            last = T
            file.write(data)
    return path
