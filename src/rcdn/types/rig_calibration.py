"""Result of a calibration of several cameras: the rig, its reprojection errors, and missing connections."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rcdn.types.base import Array, Value
from rcdn.types.calibration import Calibration, Verdict
from rcdn.types.rig import Rig


@dataclass(frozen=True)
class RigPair:
    """Two cameras of a rig, by name: the number of boards that both saw whole at the same moment (`shared`), how many
    of these were `used`, and the root mean square `rms` of their corners' residuals in both pictures, px (NaN if none
    was used)."""

    first: str
    second: str
    shared: int
    used: int
    rms: float


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
    """Delay of a camera's pictures behind their time stamps, relative to the other cameras: `moments` (1: the interval
    between two moments), with its standard deviation `std`."""

    moments: float
    std: float

    @property
    def clear(self) -> bool:
        """Whether the shift is significant: larger than 0.05 moments and than four standard deviations."""
        return bool(abs(self.moments) > max(0.05, 4 * self.std))


@dataclass(frozen=True, eq=False)
class RigCalibration(Value):
    """Cameras of a rig with the data that show the quality of their calibration.

    `rig`: the connected cameras and their poses; its frame is that of its first camera. `cameras`: by name, each
    camera's own calibration after the joint solution; unconnected cameras keep their separate calibration. `boards`:
    T_rig_board (4, 4), m, by (moment, number of the board's target). `rms` reprojection error over all used corners,
    px. `pairs` of cameras that saw boards together. `components`: names of the cameras in each connected component of
    the graph of shared boards, the largest first; `links`: the missing connection of each other component to the first.
    `thin`: cameras connected by a single shared board. `shifts`: time shifts by name, for cameras that saw a moving
    board.
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
    verdict: Verdict | None = None

    def __repr__(self) -> str:
        level = "not judged" if self.verdict is None else self.verdict.level
        return f"<RigCalibration: {level}, {len(self.rig.names)} of {len(self.cameras)} cameras, rms {self.rms:.3g} px>"
