"""The joint problem of a rig: the corners of all participating views, by camera and board."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rcdn.calibration.board_points import flat_points, has_shape, plane_of
from rcdn.calibration.bundle import Corners3, State
from rcdn.calibration.labels import turn_labels
from rcdn.calibration.rig import matrix
from rcdn.calibration.rig_fit import Joint
from rcdn.calibration.rig_start import Key, Turned
from rcdn.calibration.shape import FUNCTIONS, shape_basis
from rcdn.types import Array, Calibration


@dataclass(frozen=True, eq=False)
class RigTask:
    """The joint problem: the `cameras` in it by their numbers, first that of the rig's frame; frames are boards, each
    with its entry of `keys` (None: the partial view of a single camera); `rows`: (camera, view) → rows of the corners,
    with labels `ij`; `cluster` (F,): moments; `known`: for each camera, whether its lens is held constant."""

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

    @classmethod
    def of(
        cls,
        main: list[int],
        alone: Sequence[Calibration],
        sights: Sequence[Mapping[Key, int]],
        fits: Turned,
        when: Sequence[Sequence[str]],
        held: list[bool],
    ) -> RigTask:
        """All views of the cameras `main` except the odd ones."""
        shaped = max(main, key=lambda c: (alone[c].shape is not None, len(alone[c].used_views)))
        odd, frame_of = set(fits.odd), {key: f for f, key in enumerate(fits.boards)}
        owner = {(c, k): key for c in main for key, k in sights[c].items()}
        keys: list[Key | None] = list(fits.boards)
        firsts: list[tuple[Key | None, int, int]] = [(key, -1, -1) for key in fits.boards]
        moments = [key[0] for key in fits.boards]
        frame, camera, ij, flat, known, xy, sigma, rows, at = [], [], [], [], [], [], [], {}, 0
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
                    f = frame_of[key]
                turn = fits.turns.get((c, k), 0)
                labels = turn_labels(view.ij, alone[c].size or (1, 1), turn) if turn else view.ij
                frame.append(np.full(len(view), f))
                camera.append(np.full(len(view), local))
                ij.append(labels)
                flat.append(flat_points(alone[c], view, labels))
                known.append(np.full(len(view), has_shape(alone[shaped], view)))
                xy.append(view.xy)
                sigma.append(np.nan_to_num(view.sigma))
                rows[c, k] = np.arange(at, at + len(view))
                at += len(view)
        joint, board, settled = np.concatenate(ij), np.concatenate(flat), np.concatenate(known)
        basis = np.zeros((len(joint), len(FUNCTIONS)))
        if settled.any():
            basis[settled] = shape_basis(joint[settled], alone[shaped].size or (1, 1), plane_of(alone[shaped]))
        corners = Corners3(np.concatenate(frame), np.concatenate(camera), board, np.concatenate(xy), basis)
        cluster = np.unique(np.array(moments), return_inverse=True)[1]
        return cls(main, keys, firsts, corners, np.concatenate(sigma), joint, rows, cluster, fits, shaped, held)

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
        )

    @property
    def joint(self) -> Joint:
        """Input of the least-squares fit."""
        return Joint(self.corners, self.sigma, self.cluster, self.known)
