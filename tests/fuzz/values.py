"""Values that callers make: boards, cameras, corners, settings; and what is computed from them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from tests.fuzz import samples
from tests.fuzz.source import ODD_REALS, Source
from tests.fuzz.target import Target, must
from tests.fuzz.texts import see, valid_camera

import rcdn
from rcdn import DetectorConfig
from rcdn.config import Adaptive, Cluster, Fixed, MaxFraction, Nms, Refine, Sharpen, Std
from rcdn.errors import RcdnError
from rcdn.precision import sharpen
from rcdn.types import LENS, Array, Board, BoardShape, Camera, Corners
from rcdn_lab.camera_scenes import CAMERAS, SPACING

ORIENTATIONS = ("unique", "ambiguous_180", "ambiguous_90", "ambiguous_120")
INTEGERS = (0, 1, -1, 2, 7, 1000, 2**20, 2**31, -(2**31), 2**62, -(2**62))


def _board(source: Source) -> dict[str, Any]:
    """Arguments of a Board: those of a good one with some of them changed."""
    good = source.choice(samples.boards())
    given: dict[str, Any] = {
        "xy": good.xy.copy(), "ij": good.ij.copy(), "image_size": good.image_size, "response": good.response.copy(),
        "status": good.status.copy(), "orientation": source.choice(ORIENTATIONS),
        "sigma": None if good.sigma is None else good.sigma.copy(),
        "pattern": source.choice(("checker", "checker", "checker", "deltille")),
    }  # fmt: skip
    for _ in range(source.below(4)):
        _change(source, given)
    if source.chance(4):
        n, name = len(given["ij"]), source.choice(("xy", "ij", "response", "status", "sigma"))
        given[name] = source.choice(
            (None, [], np.zeros((2, 2)), np.zeros(n), np.full((n, 2), np.nan), [[1, 2], [3]], "text", [None] * n)
        )
    return given


def _change(source: Source, given: dict[str, Any]) -> None:
    kind, n = source.byte() % 11, len(given["ij"])
    if kind == 0:
        keep = source.random().random(n) < source.choice((0.05, 0.1, 0.3, 0.9))
        for name in ("xy", "ij", "response", "status", "sigma"):
            given[name] = given[name][keep] if given[name] is not None and len(given[name]) == n else given[name]
    elif kind == 1 and n:
        given["xy"][source.below(n), source.below(2)] = source.real()
    elif kind == 2 and n:
        given["ij"][source.below(n), source.below(2)] = source.choice(INTEGERS)
    elif kind == 3:
        given["xy"] = given["xy"] * source.choice((0.0, 1e-3, 1e-12, 1e6, 1e12, 1e150, -1.0)) + source.choice(
            (0.0, 1e3, -1e9)
        )
    elif kind == 4:
        given["xy"] = given["xy"] * [source.choice((0.0, 1.0, 1e-9)), 1.0]
    elif kind == 5:
        given["ij"] = given["ij"] * source.choice(INTEGERS)
    elif kind == 6:
        given["image_size"] = source.choice(
            ((0, 0), (-1, 5), (1, 1), (2**31, 2**31), (640, 480), (10**400, 3), (3.5, 2.5), (640,))
        )
    elif kind == 7 and given["sigma"] is not None and len(given["sigma"]):
        given["sigma"][source.below(len(given["sigma"])) :] = source.real()
    elif kind == 8:
        given["xy"] = given["xy"] + source.random().normal(0, source.choice((0.1, 3.0, 100.0)), given["xy"].shape)
    elif kind == 9:
        given["xy"] = np.repeat(given["xy"][:1], n, axis=0) if n else given["xy"]
    else:
        given["ij"] = given["ij"][:, ::-1]


def _camera(source: Source) -> dict[str, Any]:
    """Arguments of a Camera."""
    good = source.choice([*CAMERAS.values(), samples.corrected()])
    given: dict[str, Any] = {
        "K": good.K.copy(),
        "distortion": good.distortion.copy(),
        "image_size": good.image_size,
        "model": good.model,
        "correction": good.correction,
    }
    for _ in range(source.below(3)):
        kind = source.byte() % 6
        if kind == 0:
            given["K"].flat[source.below(9)] = source.real()
        elif kind == 1 and isinstance(given["distortion"], np.ndarray) and len(given["distortion"]):
            given["distortion"][source.below(len(given["distortion"]))] = source.real()
        elif kind == 2:
            given["model"] = source.choice([*LENS, "other", None])
        elif kind == 3:
            given["image_size"] = source.choice(((0, 0), (-1, 5), (1, 1), (2**31, 2**31), (4, 3), (3.5, 2.5)))
        elif kind == 4:
            given["distortion"] = source.choice(
                ([], [0.0], [np.nan] * 4, [1e308] * 5, [0.1] * 8, "text", None, [[0.1]])
            )
        else:
            given["K"] = given["K"] * source.choice((0.0, 1e-300, 1e300, -1.0))
    return given


@cache
def _grey() -> Array:
    return np.ascontiguousarray(samples.picture(9, 6, 22.0, (640, 480)))


def _use_board(given: dict[str, Any]) -> None:
    board = Board(**given)
    _ = board.size, board.complete, board.points, len(board)
    must(len(np.unique(board.ij, axis=0)) == len(board), "a label twice")
    if len(board) and np.ptp(board.ij.astype(float), axis=0).max() < 1000:
        board.grid()
    board.grid_of((9, 6))


def _use_camera(given: dict[str, Any]) -> None:
    """Rays and pixels of any camera come without an output; NaN where there are none."""
    see(Camera(**given))


def _pose(source: Source) -> tuple[dict[str, Any], dict[str, Any], float]:
    spacing = SPACING if source.byte() % 4 else source.real()
    plain = {"K": CAMERAS["brown"].K, "distortion": CAMERAS["brown"].distortion, "image_size": (640, 480)}
    return _board(source), _camera(source) if source.chance(3) else plain, spacing


def _use_pose(given: tuple[dict[str, Any], dict[str, Any], float]) -> None:
    found = rcdn.estimate_pose(Board(**given[0]), Camera(**given[1]), given[2])
    must(np.isfinite(found.T_cam_board).all(), "a pose isn't finite")
    must(np.isfinite(found.rms), "an rms isn't finite")


def _sharpen(given: dict[str, Any]) -> None:
    """A detection's board, with positions and labels as they come."""
    board = Board(**given)
    if not np.isfinite(board.xy).all():
        return  # no recovery gives such
    out = sharpen(_grey(), board)
    must(len(out) == len(board), "corners lost")
    must(np.isfinite(out.xy).all(), "a position isn't finite")


def _set(source: Source) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Boards and options of a calibration."""
    boards = [_board(source) for _ in range(source.choice((0, 1, 2, 3, 4, 6)))]
    options = {
        "spacing": SPACING if source.byte() % 4 else source.real(),
        "model": source.choice(("pinhole", "radtan", "fisheye", "brown", "pinhole", "other")),
        "size": source.choice((None, None, (9, 6), (6, 9), (3, 3), (0, 0), (10**9, 10**9))),
        "flat": bool(source.byte() % 4),
        "fix": source.choice(((), (), ("aspect",), "aspect", ("nothing",))),
    }
    return boards, options


def _calibrate(given: tuple[list[dict[str, Any]], dict[str, Any]]) -> None:
    boards = []
    for one in given[0]:
        try:
            boards.append(Board(**one))
        except RcdnError:
            continue
    options = dict(given[1])
    found = rcdn.calibrate(boards, options.pop("spacing"), **options)
    valid_camera(found.camera)
    must(np.isfinite(found.cov).all(), "a covariance isn't finite")


def _settings(source: Source) -> tuple[type, dict[str, Any]]:
    kinds: dict[type, tuple[str, ...]] = {
        Adaptive: ("level",), Fixed: ("value",), Std: ("factor",), MaxFraction: ("fraction",),
        Nms: ("box", "overlap", "peaks"), Cluster: ("k", "drop", "least", "seed"), Refine: ("method", "half"),
        Sharpen: ("geometry",),
        DetectorConfig: (
            "border", "seed", "weak", "min_corners", "threads", "model", "nms", "cluster", "refine", "sharpen",
            "pyramid", "pattern", "recovery",
        ),
    }  # fmt: skip
    kind = source.choice(tuple(kinds))
    names = kinds[kind]
    odd = (source.real, source.integer, source.value)
    return kind, {source.choice(names): source.choice(odd)() for _ in range(source.between(1, 2))}


def _use_settings(given: tuple[type, dict[str, Any]]) -> None:
    """Settings that are taken must work."""
    kind, values = given
    made: Any = kind(**values)
    fields = {Nms: "nms", Cluster: "cluster", Refine: "refine", Sharpen: "sharpen", DetectorConfig: ""}
    name = fields.get(kind, "threshold")
    config = replace(DetectorConfig(threads=1), **{name: made}) if name else made
    if config.threads <= 4 and config.model in ("auto", "paper"):
        rcdn.Detector(config).detect(samples.picture())


def _corners(source: Source) -> dict[str, Any]:
    n = source.below(6)
    rng = source.random()
    given: dict[str, Any] = {
        "xy": rng.uniform(0, 100, (n, 2)),
        "response": rng.random(n),
        "status": np.zeros(n),
        "axes": rng.random((n, 2)),
        "sigma": None,
    }
    for _ in range(source.below(3)):
        odd = (
            source.real(),
            None,
            [],
            np.zeros((n, 3)),
            np.full(n, source.choice(ODD_REALS)),
            [source.integer()] * n,
            "text",
            [[1], [2, 3]],
        )
        given[source.choice(tuple(given))] = source.choice(odd)
    return given


def _use_corners(given: dict[str, Any]) -> None:
    corners = Corners(**given).sort()
    must(len(corners.take(slice(0, 2))) == min(2, len(corners)), "corners lost")


def _shape(source: Source) -> Any:
    odd = (
        np.zeros((3, 4, 3)),
        np.zeros((3, 4, 3)) + source.real(),
        np.zeros((0, 4, 3)),
        np.zeros((3, 4)),
        None,
        "text",
        [[[1, 2, 3]]],
        [[[None] * 3]],
    )
    return source.choice(odd), source.random().integers(-3, 6, (4, 2))


def _use_shape(given: Any) -> None:
    shape = BoardShape(given[0])
    _ = shape.size
    if shape.offsets.size and np.abs(shape.offsets).max() < 1e100:
        _ = shape.bend, shape.print_error, shape.stretch
    shape.at(given[1])


TARGETS = [
    Target("boards", _board, _use_board, share=0.5),
    Target("corners", _corners, _use_corners, share=0.25),
    Target("lenses", _camera, _use_camera, share=0.5),
    Target("shapes", _shape, _use_shape, share=0.25),
    Target("options", _settings, _use_settings, tries=20),
    Target("poses", _pose, _use_pose, tries=15),
    Target("sharpening", _board, _sharpen),
    Target("calibration", _set, _calibrate, share=2, tries=10),
]
