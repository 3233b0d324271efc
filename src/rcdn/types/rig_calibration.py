"""Result of a calibration of several cameras: the rig, its reprojection errors, and missing connections."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rcdn.types.base import Array, Value, freeze
from rcdn.types.calibration import NOT_JUDGED, Calibration, Verdict, level_in_words, verdict_html
from rcdn.types.rig import Rig
from rcdn.types.shown import paragraph, table


@dataclass(frozen=True)
class RigPair:
    """Two cameras of a rig, by name: `shared` boards that both saw whole at one moment, those of them that were `used`,
    and the root mean square `rms` of their corners' residuals in both pictures, px (NaN if none was used). `epipolar`:
    of the corners' distances from each other's epipolar planes in moments that were held out, under lenses and places
    that were solved for without them, px (NaN unless both cameras are in the rig and other moments connect them)."""

    first: str
    second: str
    shared: int
    used: int
    rms: float
    epipolar: float = float("nan")


@dataclass(frozen=True)
class MissingLink:
    """A connection that is missing between two parts of a rig: cameras `first` and `second` by name, and their pictures
    that come closest to a shared board, "" for a camera that saw none. `same_moment`: both pictures were taken at the
    same moment, but don't show the same whole board."""

    first: str
    second: str
    first_picture: str
    second_picture: str
    same_moment: bool


@dataclass(frozen=True)
class TimeShift:
    """How much later than its stamp a camera's pictures were taken, against those of the camera that most others are in
    step with: `moments` (1: the time from one to the next, or a frame, where they have numbers), with its standard
    deviation `std`, NaN if only whole moments are known."""

    moments: float
    std: float

    @property
    def clear(self) -> bool:
        """Whether the shift is significant: larger than 0.05 moments and than four standard deviations, if known."""
        return bool(abs(self.moments) > 0.05 and not abs(self.moments) <= 4 * self.std)


@dataclass(frozen=True, eq=False)
class FixedBoard(Value):
    """One of several boards that are fixed to each other: the number of its `target`, as in `RigCalibration.boards`,
    its `name`, the number of the `first` board of its set, and `T_first_board` (4, 4), which takes its coordinates to
    those of the first, m, with the covariance `cov` (6, 6) of its left increment (rotation vector, rad; translation,
    m), zero for the first board itself."""

    target: int
    name: str
    first: int
    T_first_board: Array
    cov: Array

    def __post_init__(self) -> None:
        freeze(self, "T_first_board", self.T_first_board, np.float64, (4,))
        freeze(self, "cov", self.cov, np.float64, (6,))

    def __repr__(self) -> str:
        x, y, z = self.T_first_board[:3, 3]
        return f"<FixedBoard: {self.name} at ({x:.4g}, {y:.4g}, {z:.4g})>"


@dataclass(frozen=True, eq=False)
class RigCalibration(Value):
    """Cameras of a rig with the data that show the quality of their calibration.

    `rig`: the cameras that are connected and where they stand; its frame is that of its first camera. `cameras`: by
    name each camera's own calibration after the joint solution, those that aren't connected as they are alone.
    `boards`: by (moment, number of the board's target) T_rig_board (4, 4), m. `rms` reprojection error over all used
    corners, px. `pairs` of cameras that saw boards together. `components`: names of cameras that boards connect, the
    largest part first; `links`: what would join each other part to the first. `thin`: cameras that hang on one shared
    board. `shifts`: by name, of cameras that saw a moving board. `given`: names of cameras whose lens was given and
    held; its covariance is zero. `corrected`: names of cameras that were brought into step; poses of their views are
    those when the pictures were really taken. `fixed_boards`: the boards whose relative poses were estimated, each
    set's first board first.
    """

    rig: Rig
    cameras: Mapping[str, Calibration]
    boards: Mapping[tuple[str, int], Array]
    rms: float
    pairs: tuple[RigPair, ...]
    components: tuple[tuple[str, ...], ...]
    links: tuple[MissingLink, ...] = ()
    thin: tuple[str, ...] = ()
    shifts: Mapping[str, TimeShift] | None = None
    verdict: Verdict = NOT_JUDGED
    given: tuple[str, ...] = ()
    corrected: tuple[str, ...] = ()
    fixed_boards: tuple[FixedBoard, ...] = ()

    def __repr__(self) -> str:
        return f"<RigCalibration: {level_in_words(self.verdict)}, {self._facts}>"

    def _repr_html_(self) -> str:
        rows = [(*row, f"{self.cameras[row[0]].rms:.3g}") for row in self.rig._rows()]
        rows += [(name, "not connected", "", "", "") for name in self.cameras if name not in self.rig.names]
        shown = table(("camera", "lens", "px", "centre, m", "rms, px"), rows)
        return verdict_html("Rig calibration", self.verdict) + paragraph(self._facts) + shown

    @property
    def _facts(self) -> str:
        return f"{len(self.rig.names)} of {len(self.cameras)} cameras, rms {self.rms:.3g} px"
