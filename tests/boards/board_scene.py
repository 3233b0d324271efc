"""Pictures of boards with exact corners, and what the recovery makes of them; no network is needed."""

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
from scipy.spatial import cKDTree

from rcdn.boards import find_boards
from rcdn.boards.graph import Field
from rcdn.corners import Candidates
from rcdn.corners.orientation import axes
from rcdn.synthetic import Background, Bend, BoardSpec, Scene, Sensor, render, truth
from rcdn.types import Corners, Status

SIZE = (480, 360)


def scene(cols=7, rows=5, pitch=30.0, roll=10.0, tilt=20.0, lean=40.0, boards=None, noise=2.0, focal=500.0, **changes):
    """One board in the middle of the frame (angles in degrees), or `boards`; other settings of a Scene by name."""
    boards = boards or (board(cols, rows, pitch, roll, tilt, lean, focal=focal),)
    clean = Scene(*SIZE, focal, (SIZE[0] / 2 - 0.5, SIZE[1] / 2 - 0.5), boards=boards, sensor=Sensor(noise=noise))
    return replace(clean, background=Background("plain", 3), seed=1, **changes)


def board(cols=7, rows=5, pitch=30.0, roll=10.0, tilt=20.0, lean=40.0, at=(0.0, 0.0), focal=500.0, **changes):
    """A board whose middle is `at` px from the frame's: turned by `roll`, then tilted about the axis at `lean`."""
    turn = cv2.Rodrigues(np.array([0, 0, np.radians(roll)]))[0]
    axis = np.array([np.cos(np.radians(lean)), np.sin(np.radians(lean)), 0])
    R = cv2.Rodrigues(np.radians(tilt) * axis)[0] @ turn
    far = focal / pitch
    t = np.array([at[0] / pitch, at[1] / pitch, far]) - R @ [(cols - 1) / 2, (rows - 1) / 2, 0]
    return BoardSpec(cols, rows, tuple(cv2.Rodrigues(R)[0].ravel().tolist()), tuple(t.tolist()), **changes)


class View:
    """A rendered scene: `grey`, and all its corners with `xy` (N, 2), `ij` (N, 2) and the `board` (N,) they are on."""

    def __init__(self, scene):
        self.grey = render(scene, samples=2)
        found = truth(scene)
        keep = [t.visible for t in found]
        self.xy = np.concatenate([t.xy[k] for t, k in zip(found, keep, strict=True)])
        self.ij = np.concatenate([t.ij[k] for t, k in zip(found, keep, strict=True)])
        self.board = np.concatenate([np.full(k.sum(), n) for n, k in enumerate(keep)])
        self.doubtful = np.concatenate([t.xy[t.ignore] for t in found])
        self._all_ij = np.concatenate([self.ij, *[t.ij[t.ignore] for t in found]])
        self._all_board = np.concatenate([self.board, *[np.full(t.ignore.sum(), n) for n, t in enumerate(found)]])
        self.sizes = [(b.cols, b.rows) for b in scene.boards]

    def __len__(self):
        return len(self.xy)

    def index(self, i, j, board=0):
        """Number of the corner (i, j)."""
        return int(np.flatnonzero((self.ij == [i, j]).all(axis=1) & (self.board == board))[0])

    def candidates(self, without=(), weak=(), extra=None, response=None, jitter=0.05, moved=None, seed=0):
        """Candidates at the true corners, `jitter` px off. `without`, `weak`: numbers of corners left out, or weak;
        `extra` (M, 2): further strong ones; `response` (N + M,); `moved`: {number: (dx, dy)}.
        """
        rng = np.random.default_rng(seed)
        xy = self.xy + rng.normal(0, jitter, self.xy.shape)
        for k, step in (moved or {}).items():
            xy[k] += step
        extra = np.zeros((0, 2)) if extra is None else np.asarray(extra, float).reshape(-1, 2)
        strong = np.ones(len(xy) + len(extra), bool)
        strong[list(weak)] = False
        score = np.where(strong, 0.9, 0.5) + rng.uniform(0, 0.05, len(strong)) if response is None else response
        keep = np.delete(np.arange(len(strong)), list(without))
        return candidates(self.grey, np.concatenate([xy, extra])[keep], score[keep], strong[keep])

    def found(self, least=9, **changes):
        """Boards found among `candidates(**changes)`."""
        return find_boards(self.grey, self.candidates(**changes), least)

    def field(self, **changes):
        """What the stages see of `candidates(**changes)`, and which corner of the view each is (−1: none)."""
        return self.field_of(self.candidates(**changes))

    def field_of(self, given):
        """A Field and the corners' numbers in this view."""
        xy, seen = given.all.xy, given.orientation
        refined = given.all.status != Status.SEED
        field = Field(
            self.grey, xy, seen.axes, seen.polarity.astype(int), seen.contrast, seen.fit, given.all.response,
            given.seed, refined,
        )  # fmt: skip
        return field, self.number(xy)

    def number(self, xy, radius=2.0):
        """Which corner (N,) lies within `radius` px of each of `xy` (N, 2); −1 for none."""
        return _nearest(self.xy, xy, radius)

    def wrong(self, found):
        """How many corners of a recovered board are no corner, are on another board, or have a wrong label.
        Half-covered ones count like the others.

        Labels may differ from the printed ones by quarter turns and shifts, but by one of them for the whole board.
        """
        number = _nearest(np.concatenate([self.xy, self.doubtful]), found.xy, 2.0)
        spurious = int((number < 0).sum())
        number, ij = number[number >= 0], found.ij[number >= 0]
        return (
            spurious
            + len(number)
            - max((self._agree(number, ij, k, n) for k in range(4) for n in range(len(self.sizes))), default=0)
        )

    def _agree(self, number, ij, quarters, board):
        mine = self._all_board[number] == board
        if not mine.any():
            return 0
        shift = ij[mine] - turn(self._all_ij[number[mine]], quarters)
        return int(np.unique(shift, axis=0, return_counts=True)[1].max())


def _nearest(known, xy, radius):
    """Which of `known` (N, 2) lies within `radius` px of each of `xy` (M, 2); −1 for none."""
    if not len(xy):
        return np.zeros(0, int)
    gap, index = cKDTree(known).query(xy)
    return np.where(gap < radius, index, -1)


def turn(ij, quarters):
    """Right-handed quarter turns of labels about (0, 0)."""
    for _ in range(quarters % 4):
        ij = np.stack([-ij[:, 1], ij[:, 0]], axis=1)
    return ij


def candidates(grey, xy, response, strong):
    """Candidates at `xy`, in the order of `Corners`, with axes measured in the picture as the detector does it."""
    near = cKDTree(xy[strong]).query(xy, k=2)[0]
    pitch = np.where(near[:, 0] > 0, near[:, 0], near[:, 1])
    seen = axes(grey, xy, np.clip(0.35 * pitch, 3, 10))
    order = np.lexsort((xy[:, 1], xy[:, 0], -response))
    seen = replace(
        seen, axes=seen.axes[order], contrast=seen.contrast[order], polarity=seen.polarity[order], fit=seen.fit[order]
    )
    all_ = Corners(xy[order], response[order], np.zeros(len(xy)), seen.axes)
    return Candidates(all_, seen, sure=strong[order], seed=strong[order])


def clutter(shown, count, seed, apart=5.0):
    """Random points (≤ count, 2) that are no corner of the view: `apart` px and more from each."""
    points = np.random.default_rng(seed).uniform(4, np.array(SIZE) - 5, (count, 2))
    known = np.concatenate([shown.xy, shown.doubtful])
    return points[cKDTree(known).query(points)[0] > apart] if len(known) else points


def right_handed(found):
    """Does the step along columns turn clockwise on the screen into the step along rows?"""
    A = np.linalg.lstsq(np.column_stack([found.ij, np.ones(len(found))]), found.xy, rcond=None)[0]
    return bool(np.linalg.det(A[:2]) > 0)


WIDE = {"cols": 9, "rows": 6}
VIEWS = {
    "flat": {"tilt": 0, "roll": 0, "noise": 0},
    "tilted": {"tilt": 55, "roll": 25, "lean": 70, "pitch": 34},
    "noisy": {"tilt": 30, "noise": 20},
    "small": WIDE | {"pitch": 11, "tilt": 20},
    "barrel": WIDE | {"pitch": 44, "tilt": 25, "model": "brown", "distortion": (-0.35, 0.08, 0, 0, 0)},
    "fisheye": {
        "cols": 9,
        "rows": 6,
        "pitch": 48,
        "tilt": 30,
        "focal": 170,
        "model": "fisheye",
        "distortion": (0.03, 0, 0, 0),
    },
    "cylinder": {"bend": Bend(curvature=0.12, angle=0.5), "tilt": 25},
    "wave": {"bend": Bend(amplitude=0.3, period=7, angle=1.0), "tilt": 15, "pitch": 36},
    "negative": {"swap": True, "tilt": 35, "roll": 200},
}
"""Settings for `view`: what recovery must get wholly right."""


@lru_cache(maxsize=64)
def _view(key):
    settings = dict(key)
    own = {name: settings.pop(name) for name in ("bend", "swap", "margin") if name in settings}
    made = scene(**settings)
    return View(replace(made, boards=tuple(replace(b, **own) for b in made.boards)))


def view(name="", **settings):
    """The View called `name`, or a board with these settings; rendered once."""
    return _view(tuple((VIEWS[name] | settings if name else settings).items()))
