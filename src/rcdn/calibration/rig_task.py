"""The joint problem of a rig: the corners of all participating views, by camera and board."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rcdn.calibration.board_points import flat_points, has_shape, plane_of
from rcdn.calibration.bundle import Corners3, State
from rcdn.calibration.fixed_boards import FixedBoards
from rcdn.calibration.relative_pose import matrix
from rcdn.calibration.rig_fit import Joint
from rcdn.calibration.rig_start import Key, Turned
from rcdn.calibration.shape import FUNCTIONS, shape_basis
from rcdn.calibration.smooth_lens import variance_of
from rcdn.geometry.order import turn_labels
from rcdn.types import Array, Calibration


@dataclass(frozen=True, eq=False)
class RigTask:
    """The joint problem: the `cameras` in it by their numbers, first that of the rig's frame; frames are boards, or
    sets of boards that are `fixed` to each other, each with its entry of `keys` (None: the partial view of a single
    camera); `boards`: for each board its frame; `rows`: (camera, view) → rows of the corners, with labels `ij`;
    `cluster` (F,): moments; `known`: for each camera, whether its lens is held constant."""

    cameras: list[int]
    keys: list[Key | None]
    poses: list[tuple[Key | None, int, int]]
    corners: Corners3
    sigma: Array
    ij: Array
    rows: dict[tuple[int, int], Array]
    cluster: Array
    turned: Turned
    shape: int
    known: list[bool]
    sights: Sequence[Mapping[Key, int]]
    fixed: FixedBoards
    boards: dict[Key, int]

    @classmethod
    def of(
        cls,
        main: list[int],
        alone: Sequence[Calibration],
        sights: Sequence[Mapping[Key, int]],
        fits: Turned,
        when: Sequence[Sequence[str]],
        held: list[bool],
        fixed: FixedBoards,
    ) -> RigTask:
        """All views of the cameras `main` except the odd ones; `fits` are of boards, or of sets of them (`in_sets`)."""
        shaped = max(main, key=lambda c: (alone[c].shape is not None, len(alone[c].used_views)))
        odd, frame_of = set(fits.odd), {key: f for f, key in enumerate(fits.boards)}
        owner = {(c, k): key for c in main for key, k in sights[c].items()}
        keys: list[Key | None] = list(fits.boards)
        firsts: list[tuple[Key | None, int, int]] = [(key, -1, -1) for key in fits.boards]
        moments = [key[0] for key in fits.boards]
        parts = {board: 1 + k for k, board in enumerate(fixed.others)}
        views, boards = _Views(alone[shaped]), dict[Key, int]()
        for local, c in enumerate(main):
            for k, view in enumerate(alone[c].views):
                if view.reason or view.pose is None or (c, k) in odd:
                    continue
                key = owner.get((c, k))
                if key is None:
                    f = len(keys)
                    keys.append(None)
                    firsts.append((None, c, k))
                    moments.append(when[c][k])
                else:
                    f = boards[key] = frame_of[key[0], fixed.first_of(key[1])]
                part = 0 if key is None else parts.get(key[1], 0)
                views.add(alone[c], (c, k), f, local, fits.turns.get((c, k), 0), part)
        rows = views.joined()
        basis = np.zeros((len(rows.ij), len(FUNCTIONS)))
        if rows.shaped.any():
            size = alone[shaped].size or (1, 1)
            basis[rows.shaped] = shape_basis(rows.ij[rows.shaped], size, plane_of(alone[shaped]))
        corners = Corners3(rows.frame, rows.camera, rows.flat, rows.xy, basis, rows.part if parts else None)
        return cls(
            cameras=main,
            keys=keys,
            poses=firsts,
            corners=corners,
            sigma=rows.sigma,
            ij=rows.ij,
            rows=views.rows,
            cluster=np.unique(np.array(moments), return_inverse=True)[1],
            turned=fits,
            shape=shaped,
            known=held,
            sights=sights,
            fixed=fixed,
            boards=boards,
        )

    @classmethod
    def of_two(
        cls,
        pair: tuple[int, int],
        alone: Sequence[Calibration],
        sights: Sequence[Mapping[Key, int]],
        turns: Mapping[Key, int],
        when: Sequence[Sequence[str]],
        known: tuple[bool, bool],
    ) -> RigTask:
        """The views of two cameras, which share the boards `turns` alone; the values are quarter turns of the second
        camera's labels."""
        a, b = pair
        shared = [{k: each[k] for k in turns} if c in pair else {} for c, each in enumerate(sights)]
        boards = {key: matrix(alone[a].views[shared[a][key]]) for key in turns}
        labels = {(b, shared[b][key]): turn for key, turn in turns.items()}
        return cls.of([a, b], alone, shared, Turned(labels, [], boards), when, list(known), FixedBoards())

    def start(self, alone: Sequence[Calibration], places: Mapping[int, Array]) -> State:
        """Initial guess: boards and cameras at the poses of the graph."""
        poses = [
            self.turned.boards[key] if key is not None else np.linalg.inv(places[c]) @ matrix(alone[c].views[k])
            for key, c, k in self.poses
        ]
        return State(
            tuple(alone[c].camera for c in self.cameras),
            np.array(poses),
            np.stack([places[c] for c in self.cameras]),
            boards=np.stack([np.eye(4), *(self.fixed.place_of(b) for b in self.fixed.others)]),
            smooth=tuple(0.0 if h else variance_of(alone[c]) for c, h in zip(self.cameras, self.known, strict=True)),
        )

    def pose(self, state: State, camera: int, view: int) -> Array:
        """T_rig_board (4, 4) of the board of a view, by a solution."""
        row = self.rows[camera, view][0]
        part = 0 if self.corners.part is None else self.corners.part[row]
        return np.asarray(state.poses[self.corners.frame[row]] @ state.boards[part])

    def poses_of(self, state: State) -> dict[Key, Array]:
        """T_rig_board (4, 4) of each board that has a name, by a solution."""
        parts = {board: 1 + k for k, board in enumerate(self.fixed.others)}
        return {key: state.poses[f] @ state.boards[parts.get(key[1], 0)] for key, f in self.boards.items()}

    @property
    def joint(self) -> Joint:
        """Input of the least-squares fit."""
        return Joint(self.corners, self.sigma, self.cluster, self.known)


class _Rows(NamedTuple):
    """A row for each of N corners: `frame` and `camera` (N,) numbers, labels `ij` (N, 2), places on the board `flat`
    (N, 3) m, `xy` (N, 2) and `sigma` (N,) px; `shaped` (N,): whether the board's shape applies; `part` (N,) of a set of
    boards."""

    frame: Array
    camera: Array
    ij: Array
    flat: Array
    xy: Array
    sigma: Array
    shaped: Array
    part: Array


class _Views:
    """Views gathered one after another; `shaped`: the calibration whose board's shape may apply. `rows`: rows of the
    corners by view."""

    def __init__(self, shaped: Calibration) -> None:
        self._shaped, self._parts, self._count = shaped, list[_Rows](), 0
        self.rows: dict[tuple[int, int], Array] = {}

    def add(
        self, of: Calibration, name: tuple[int, int], frame: int, camera: int, turn: int = 0, part: int = 0
    ) -> None:
        """Add the view `name` (its camera, its number in `of`), its labels turned by `turn` quarter turns."""
        view = of.views[name[1]]
        ij = turn_labels(view.ij, of.size or (1, 1), turn) if turn else view.ij
        numbers = (np.full(len(view), k) for k in (frame, camera, has_shape(self._shaped, view), part))
        frames, cameras, shaped, parts = numbers
        sigma = np.nan_to_num(view.sigma)
        self._parts.append(_Rows(frames, cameras, ij, flat_points(of, view, ij), view.xy, sigma, shaped, parts))
        self.rows[name] = np.arange(self._count, self._count + len(view))
        self._count += len(view)

    def joined(self) -> _Rows:
        """The rows of all views."""
        return _Rows(*map(np.concatenate, zip(*self._parts, strict=True)))
