"""The joint problem of a rig: the corners of all participating views, by camera and board."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rcdn.calibration.board_points import plane_of
from rcdn.calibration.bundle import Corners3, State
from rcdn.calibration.fixed_boards import FixedBoards
from rcdn.calibration.joint_views import JointViews
from rcdn.calibration.relative_pose import matrix
from rcdn.calibration.rig_fit import Joint
from rcdn.calibration.rig_start import Key, Turned
from rcdn.calibration.shape import FUNCTIONS, shape_basis
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
        views, boards = JointViews(alone[shaped]), dict[Key, int]()
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
