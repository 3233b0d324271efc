"""Paths of boards that move before several cameras: their times, velocities, and poses between moments."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from rcdn.calibration.bundle import State, middles
from rcdn.calibration.rig_task import RigTask
from rcdn.types import Array

STAMPS = 1000
"""median difference of the moments' numbers above which they are time stamps, not frames: the unit is then that
difference"""
STILL = 1e-3
"""least displacement of a board between moments to count as moving, share of its distance"""
JUMP = 3.0
"""× the larger of the steps before and after it: a longer step isn't a part of the path"""
REACH = 2
"""most neighbours on either side through which the path's polynomial goes"""
NEAR = 2.0
"""× the median time between moments: neighbours farther apart give no velocity"""


def times_of(moments: Iterable[str]) -> dict[str, float]:
    """The time of each moment.

    That is its trailing number if all end in different ones (unit: one frame, or, for time stamps, their median
    difference), else its rank.
    """
    names = list(dict.fromkeys(moments))
    found = [re.search(r"(\d+)\D*$", name) for name in names]
    numbers = [int(match[1]) for match in found if match is not None]
    if len(numbers) == len(names) and len(set(numbers)) == len(names):
        typical = float(np.median(np.diff(np.unique(numbers)))) if len(numbers) > 1 else 1.0
        unit = typical if typical > STAMPS else 1.0
        return {name: n / unit for name, n in zip(names, numbers, strict=True)}
    return {name: float(k) for k, name in enumerate(sorted(names))}


@dataclass(frozen=True, eq=False)
class Path:
    """Path of the boards over time: `frame`s of the joint problem in the order of their `time` (F,), each target's
    contiguous; poses `T` (F, 4, 4) and the `middle` (F, 3) of each board on it; `reach` (F,): how many neighbours on
    either side are of the same target and close in time, at most REACH."""

    frame: Array
    time: Array
    T: Array
    middle: Array
    reach: Array

    @classmethod
    def of(cls, task: RigTask, state: State, time: Mapping[str, float]) -> Path:
        """The path of all boards shared by the cameras of `task`."""
        shared = [(key[1], time[key[0]], f) for f, key in enumerate(task.keys) if key is not None]
        target, when, frame = (
            (np.array(column) for column in zip(*sorted(shared), strict=True)) if shared else (np.zeros(0),) * 3
        )
        frame = frame.astype(int)
        gap = np.where(np.diff(target) == 0, np.diff(when), np.inf)
        typical = float(np.median(gap[np.isfinite(gap)])) if np.isfinite(gap).any() else 0.0
        T, middle, close = state.poses[frame], middles(state, task.corners)[frame], gap <= NEAR * typical
        path = cls(frame, when, T, middle, np.zeros(len(frame), int))
        return replace(path, reach=_reach(close & ~_jumps(path.places, close)))

    @property
    def near(self) -> Array:
        """(F,) bool: boards whose velocity is known."""
        return np.asarray(self.reach > 0)

    @property
    def places(self) -> Array:
        """(F, 3) m: centres of the boards."""
        return (self.T[:, :3, :3] @ self.middle[:, :, None])[..., 0] + self.T[:, :3, 3]

    @property
    def velocity(self) -> Array:
        """(F, 3) m per moment: velocities of the boards' centres; NaN without close neighbours."""
        out, places = np.full((len(self.frame), 3), np.nan), self.places
        for k in np.flatnonzero(self.near).tolist():
            some, t = self._around(k)
            out[k] = _derivative(t) @ places[some]
        return out

    @property
    def moving(self) -> Array:
        """(F,) bool: boards with a known velocity that clearly move."""
        return np.asarray(np.linalg.norm(self.velocity, axis=1) > STILL * np.linalg.norm(self.places, axis=1))

    @property
    def motion(self) -> Array:
        """(F, 6): the motion of each moving board in a moment, a rotation vector about the origin of the first camera,
        then a translation, m (`State.velocity`); zero for the others."""
        out, places, velocity = np.zeros((len(self.frame), 6)), self.places, self.velocity
        for k in np.flatnonzero(self.moving).tolist():
            some, t = self._around(k)
            out[k, :3] = _derivative(t) @ self._turns(some, k)
            out[k, 3:] = velocity[k] - np.cross(out[k, :3], places[k])
        return out

    def later(self, by: float) -> Array:
        """(F, 4, 4): the poses `by` moments after each one's own; NaN where the path is unknown there."""
        out, places = np.full((len(self.frame), 4, 4), np.nan), self.places
        middle = np.flatnonzero(self.near)
        for k in range(len(self.frame)):
            then = self.time[k] + by
            if not len(middle):
                break
            m = int(middle[np.argmin(np.abs(self.time[middle] - then) + 1e9 * (np.abs(middle - k) > abs(by) * 2 + 1))])
            if not self.time[m - 1] <= then <= self.time[m + 1]:
                continue
            some, t = self._around(m)
            share = _value(t, then - self.time[m])
            out[k] = np.eye(4)
            out[k, :3, :3] = Rotation.from_rotvec(share @ self._turns(some, m)).as_matrix() @ self.T[m, :3, :3]
            out[k, :3, 3] = share @ places[some] - out[k, :3, :3] @ self.middle[k]
        return out

    def _around(self, k: int) -> tuple[slice, Array]:
        """The neighbours of a board on the path, and their times after it."""
        some = slice(k - self.reach[k], k + self.reach[k] + 1)
        return some, self.time[some] - self.time[k]

    def _turns(self, some: slice, k: int) -> Array:
        """(S, 3) rotation vectors from the board `k` to `some` others."""
        return Rotation.from_matrix(self.T[some, :3, :3] @ self.T[k, :3, :3].T).as_rotvec()


def _jumps(places: Array, close: Array) -> Array:
    """(F − 1,) bool: whether the board was taken elsewhere between each of its `places` (F, 3), m, and the next, by the
    steps before and after it that are `close` (F − 1,) in time."""
    step = np.linalg.norm(np.diff(places, axis=0), axis=1)
    known = np.pad(np.where(close, step, 0.0), 1)
    beside = np.maximum(known[:-2], known[2:])
    any_beside = np.pad(close, 1)
    compared = any_beside[:-2] | any_beside[2:]
    return np.asarray(compared & (step > JUMP * beside) & (step > STILL * np.linalg.norm(places[1:], axis=1)))


def _reach(close: Array) -> Array:
    """(F,) how many neighbours on either side follow each other closely, at most REACH, by whether each but the last
    is `close` (F − 1,) to the next."""
    many = len(close) + 1
    links = np.concatenate([[False] * REACH, close, [False] * REACH])
    out, whole = np.zeros(many, int), np.ones(many, bool)
    for step in range(1, REACH + 1):
        before, after = REACH - step, REACH + step - 1
        whole = whole & links[before : before + many] & links[after : after + many]
        out += whole
    return out


def _value(t: Array, at: float) -> Array:
    """(S,) weights of the values at the times `t` (S,) in the value `at` a time of the polynomial through them
    (Lagrange)."""
    many = range(len(t))
    return np.array([np.prod([(at - t[j]) / (t[i] - t[j]) for j in many if j != i]) for i in many])


def _derivative(t: Array) -> Array:
    """(S,) weights of the values at the times `t` (S,), one of which is 0, in the derivative there of the polynomial
    through them."""
    powers = np.arange(len(t))
    return np.asarray(np.linalg.solve(t[None] ** powers[:, None], powers == 1))
