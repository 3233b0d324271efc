"""Image → response → Corners → Boards. Wiring only."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rcdn.boards import BOARDS, largest
from rcdn.boards.of_views import distinct_boards, distinct_corners
from rcdn.config import DetectorConfig
from rcdn.corners.adaptive import nearest_pitch
from rcdn.corners.faint import stretched
from rcdn.corners.response import load_model
from rcdn.errors import ConfigError, shown
from rcdn.geometry.rows import joint, rows_among
from rcdn.io import grey_of
from rcdn.precision import sharpen
from rcdn.precision.surroundings import Surroundings
from rcdn.targets.circles import Other, other_pattern
from rcdn.targets.quick_test import CornerSamples, sample_corners
from rcdn.types import Array, Board, Corners, Target, Warnings, allowed
from rcdn.types.arrays import Bool, Real
from rcdn.types.limits import READ_IN_A_MIRROR
from rcdn.types.shown import drawing, paragraph
from rcdn.views import ViewResult, Views

FITTED, PER_BOARD = (800, 4000), 100
"""largest number of corners of boards for the last fit: a minimum, and a number per megapixel (photographs have at most
2,000 a megapixel); and the overhead of each board, counted in corners"""
MOVED = 0.02
"""least move of a corner in the last fit, squares, with which a board is read again (of 51 rendered boards the 7 that
it decided had moved by .044 or more; elsewhere one of .014 is lost)"""
NO_CORNERS: dict[Other, str] = {
    "circles": "not supported: a circle grid (the gaps between its circles are no {} × {} corners)",
    "mesh": "not supported: a mesh, or squares without their corners (the bars between them are no {} × {} corners)",
}
MIRRORED = READ_IN_A_MIRROR + "{} has no numbers, since its codes are seen in a mirror; flip the picture"

CONTRADICTED = (
    "contradictory: {} × {} corners have no numbers, since their codes contradict each other: the frame is torn, or "
    "parts of several boards meet"
)


@dataclass(frozen=True, eq=False)
class Detection:
    """Detections in one image: `corners`, every X-corner above the threshold or in a board; `boards`, the grids,
    largest first.

    `warnings`: a line for each limit that left something out, since the image shows more than can be processed in the
    time allowed for its size, and for targets that are detected but `not supported`, `mirrored` or `contradictory`; a
    usual photograph has none.
    """

    corners: Corners
    boards: list[Board]
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        counts = [(len(self.corners), "corner"), (len(self.boards), "board")]
        counts += [(len(self.warnings), "warning")] * bool(self.warnings)
        return f"<Detection: {', '.join(f'{n} {what}' + 's' * (n != 1) for n, what in counts)}>"

    def _repr_html_(self) -> str:
        """A drawing of all boards, if there are any, and a line for each."""
        lines = [paragraph(line) for line in (repr(self)[1:-1], *(repr(board)[1:-1] for board in self.boards))]
        boards = [(board.xy, board.ij) for board in self.boards]
        return "".join((drawing(self.boards[0].image_size, boards, self.corners.xy) if boards else "", *lines))


class Detector:
    """Detects X-corners and boards. The size of a board need not be known.

    `config`: see `DetectorConfig`; default: the preset `auto`. Images: arrays (H, W) grey or (H, W, 3) BGR, 8 or 16 bit
    or float (docs/conventions.md), paths of image files, or PIL images. Bad input raises RcdnError; an image without a
    board gives [] and no error. A detector may be used for any number of images; the same image always gives the same
    bytes, whatever `config.threads`; with the preset `auto` and plain boards of squares, on the CPU, on every x86-64
    processor (docs/decisions/0020-the-same-bits-on-every-processor.md).
    """

    def __init__(self, config: DetectorConfig | None = None) -> None:
        self._config = DetectorConfig() if config is None else config
        if not isinstance(self.config, DetectorConfig):
            raise ConfigError(f"config must be a DetectorConfig, such as DetectorConfig.paper(), not {shown(config)}")
        if not isinstance(self.config.target, str):
            from rcdn.targets import check_target

            check_target(self.config.target)
        self._model = load_model(self.config.weights, self.config.device)

    @property
    def config(self) -> DetectorConfig:
        """The settings, which can't be changed: the network was loaded by them."""
        return self._config

    @config.setter
    def config(self, config: DetectorConfig) -> None:
        raise AttributeError("the config of a Detector can't be changed; make a new one: rcdn.Detector(config)")

    def __repr__(self) -> str:
        return f"<Detector {self.config!r} on {self._model.device}>"

    def response(self, image: Any) -> Real[Array, "h w"]:
        """Response map (H, W) float32, ≥ 0: the evidence for an X-corner at each pixel."""
        return self._model(grey_of(image), self.config.threads)

    def corners(self, image: Any) -> Corners:
        """X-corners at sub-pixel positions, by falling response."""
        return self.detect(image).corners

    def boards(self, image: Any) -> list[Board]:
        """Recovered boards, the one with the most corners first; [] if there is none."""
        return self.detect(image).boards

    def detect(self, image: Any) -> Detection:
        """Corners and boards of one image; if it is faint, of it with usual contrast, should that show more."""
        grey = grey_of(image)
        found = self._detect(grey)
        whole = bool(found.boards) and all(board.complete for board in found.boards)
        if whole or not self.config.pyramid or (clear := stretched(grey)) is None:
            return found
        return max(found, self._detect(clear), key=lambda seen: sum(map(len, seen.boards)))

    def _detect(self, grey: Array) -> Detection:
        warnings = Warnings()
        results = Views(grey, self._model, self.config, warnings).results()
        boards = distinct_boards([result.boards for result in results])
        boards = largest(boards, allowed(grey.size, *BOARDS), "boards", warnings)
        boards = self._identified(grey, boards, results, warnings)
        inside = [result.corners.take(_members(result.corners, boards)) for result in results]
        seen = joint([corners.xy for corners in inside], (0, 2))
        inside += [_predicted(board, seen) for board in boards if board.target is not None]
        whole = [result.corners for result in results if result.detailed]
        corners = distinct_corners([distinct_corners(inside, reach=0), *whole])
        corners = corners.take(_members(corners, boards) | _in_frame(corners.xy, grey.shape))
        if self.config.sharpen is not None and self.config.pattern == "checker":
            sharp = _sharpened(grey, boards, self.config.sharpen.geometry, warnings)
            corners, boards = _moved(corners, boards, sharp), sharp
        return Detection(corners, boards, warnings.texts)

    def _identified(
        self, grey: Array, boards: list[Board], results: list[ViewResult], warnings: Warnings
    ) -> list[Board]:
        """The boards identified by their codes, and the boards that codes make of pieces, unless all boards are
        certainly plain.

        Lattices of tags are kept only if their codes were read, since nothing else distinguishes them from other
        patterns. `warnings` note codes that can be read only in the mirror image, and circle grids and meshes, which
        are no boards.
        """
        if self.config.pattern == "deltille":
            return boards
        out, plain = [], bool(boards)
        for board in boards:
            samples = sample_corners(grey, board) if board.pattern == "checker" else None
            coded = self.config.target != "plain" and (samples is None or samples.may_carry_codes)
            known = self._read(grey, board, warnings) if coded else board
            plain &= not coded
            other = self._other_pattern(samples) if known.target is None else None
            if other is None:
                out.append(known)
            else:
                warnings.add(other, NO_CORNERS[other].format(*board.size))
        if self.config.target != "plain" and not plain:
            pieces = [piece for result in results for piece in result.pieces()]
            if pieces or any(board.target is not None for board in out):
                from rcdn.targets.pieces import read_pieces

                out = read_pieces(grey, out, pieces, self._given)
        out = [board for board in out if board.pattern != "aprilgrid" or board.target is not None]
        # parts of one board that its codes have completed are that board, each
        return distinct_boards([out]) if sum(board.target is not None for board in out) > 1 else out

    def _other_pattern(self, samples: CornerSamples | None) -> Other | None:
        literal = self.config.recovery == "growth"  # the paper's method does not distinguish kinds of targets
        return None if samples is None or literal else other_pattern(samples)

    def _read(self, grey: Array, board: Board, warnings: Warnings) -> Board:
        """The board with the target and labels that its codes give, if they are unambiguous."""
        from rcdn.targets.mirror import identified_or_mirrored  # here: few boards carry codes

        attempt, mirrored = identified_or_mirrored(grey, board, self._given)
        if mirrored is not None:
            warnings.add("mirrored", MIRRORED.format(mirrored))
        elif attempt.contradicted:
            warnings.add("contradictory", CONTRADICTED.format(*board.size))
        elif attempt.board.target is None and attempt.enough(self._given):
            return self._read_exact(grey, board)
        return attempt.board

    def _read_exact(self, grey: Array, board: Board) -> Board:
        """A board whose markers carry enough evidence, but don't decide, with what its codes say at the exact positions
        of the last fit: before it, corners close to large markers are off by up to a tenth of a square."""
        from rcdn.targets import identified

        if self.config.sharpen is None:
            return board
        exact = replace(sharpen(grey, board, self.config.sharpen.geometry), sigma=None)
        moved = np.linalg.norm(exact.xy - board.xy, axis=1) > MOVED * nearest_pitch(board.xy)
        known = identified(grey, exact, self._given) if moved.any() else board
        return known if known.target is not None else board

    @property
    def _given(self) -> Target | None:
        """The only target that boards may be, if the user gave one."""
        return None if isinstance(self.config.target, str) else self.config.target


def _sharpened(grey: Array, boards: list[Board], geometry: bool, warnings: Warnings) -> list[Board]:
    """The boards after the last fit, the largest first, until the allowed number of corners is used up; the others
    unchanged."""
    left, out, passed = allowed(grey.size, *FITTED), [], 0
    for board in boards:
        fits = len(board) + PER_BOARD <= left
        left -= (len(board) + PER_BOARD) * fits
        passed += len(board) * (not fits)
        around = _surroundings(grey, board) if fits else None
        fits &= board.pattern == "checker" or around is not None
        out.append(sharpen(grey, board, geometry, around) if fits else board)
    if passed:
        warnings.add("fit", f"{passed:,} corners of boards have no sigma: they are too many for the last fit")
    return out


def _surroundings(grey: Array, board: Board) -> Surroundings | None:
    """The printed surroundings of the corners of an identified board."""
    if board.target is None:
        return None
    from rcdn.targets.surroundings import surroundings  # here: few boards carry codes

    return surroundings(grey, board)


def _predicted(board: Board, seen: Real[Array, "n 2"]) -> Corners:
    """The corners of a board that are none of those `seen` (N, 2) in views: their positions were predicted from
    codes."""
    return Corners(board.xy, board.response, board.status).take(rows_among(board.xy, seen) < 0)


def _in_frame(xy: Array, shape: tuple[int, ...]) -> Bool[Array, " n"]:
    """(N,) bool: which positions lie on pixels of an image (H, W); refinement may move corners slightly beyond them."""
    return np.asarray(((xy >= -0.5) & (xy <= np.array(shape[::-1]) - 0.5)).all(axis=1))


def _members(corners: Corners, boards: list[Board]) -> Bool[Array, " n"]:
    """(N,) bool: which corners belong to a board."""
    return rows_among(corners.xy, joint([board.xy for board in boards], (0, 2))) >= 0


def _moved(corners: Corners, before: list[Board], after: list[Board]) -> Corners:
    """The corners with those of boards moved to their boards' final positions, with their sigma; NaN for the others."""
    xy, sigma = corners.xy.copy(), np.full(len(corners), np.nan)
    row = rows_among(joint([board.xy for board in before], (0, 2)), corners.xy)
    xy[row] = joint([board.xy for board in after], (0, 2))
    sigma[row] = joint([np.full(len(b), np.nan) if b.sigma is None else b.sigma for b in after], 0)
    return replace(corners, xy=xy, sigma=sigma).sort()
