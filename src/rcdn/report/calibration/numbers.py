"""The numbers of a calibration, as its page shows them: the lens, the lens models that were compared, the board."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from rcdn.calibration.facts import multiple
from rcdn.calibration.influence import held_fixed
from rcdn.geometry.spline_grid import largest_shift
from rcdn.report.calibration.formats import DASH, number, value_and_std
from rcdn.types import Calibration, Camera

MODEL_NAMES = {
    "pinhole": "pinhole (no distortion)",
    "brown": "Brown–Conrady",
    "rational": "rational (8 numbers)",
    "fisheye": "fisheye (Kannala–Brandt)",
    "division": "division (one number)",
}


@dataclass(frozen=True)
class Parameter:
    """A parameter of a lens in its unit, with its standard deviation; its name is a `symbol` of the camera files."""

    name: str
    value: str
    std: str = DASH
    unit: str = ""
    symbol: bool = False


@dataclass(frozen=True)
class Lens:
    """The `parameters` of a camera and a block of `code` with them, whose anchor ends with `key`; the `name` of the
    camera, where there are several, and whether the lens was `given`."""

    model: str
    parameters: tuple[Parameter, ...]
    code: str
    key: str
    name: str
    given: bool


@dataclass(frozen=True)
class Model:
    """The RMS of a lens model over all pictures and held out, as multiples of that of the chosen model."""

    name: str
    ratios: tuple[float, float]


@dataclass(frozen=True)
class BoardNumbers:
    """The board: `size` in inner corners; what its `spacing`, mm, is (`side`); whether it is `coded`, and the
    `targets` with the number of views that show each; its `orientation`; `shape`: its errors, mm; `noise`, px."""

    size: tuple[int, int] | None
    side: str
    spacing: float
    coded: bool
    targets: list[tuple[str, int]]
    orientation: str | None
    shape: dict[str, float] | None
    noise: float


def lens(calibration: Calibration, key: str = "", name: str = "", given: bool = False) -> Lens:
    """The parameters of the camera with their standard deviations."""
    camera, held = calibration.camera, held_fixed(calibration)
    rows = []
    every = zip(camera.parameter_names, camera.parameters, calibration.std, strict=True)
    for parameter, value, std in list(every)[: camera.coefficients]:
        unit = "px" if parameter in ("fx", "fy", "cx", "cy") else ""
        fixed = parameter in ("cx", "cy") and "principal_point" in held and not given
        texts = (f"{value:.1f}", "held") if fixed else value_and_std(float(value), float(std))
        rows.append(Parameter(parameter, *texts, unit, symbol=True))
    if camera.correction is not None:
        rows.append(Parameter("smooth correction", f"≤ {number(largest_shift(camera), 3)}", unit="px"))
    if camera.K[0, 1]:
        rows.append(Parameter("skew", number(camera.K[0, 1], 5), unit="px"))
    return Lens(MODEL_NAMES[camera.model], tuple(rows), code(camera), key, name, given)


def code(camera: Camera) -> str:
    """The camera as a block of code."""
    K = ",\n     ".join("[" + ", ".join(f"{v:.10g}" for v in row) + "]" for row in camera.K)
    coefficients = [f"{v:.10g}" for v in camera.distortion]
    rows = "".join(f"\n    {', '.join(coefficients[k : k + 2])}," for k in range(0, len(coefficients), 2))
    names = f"  # {' '.join(camera.parameter_names[4 : camera.coefficients])}" if coefficients else ""
    lines = [
        f'model = "{camera.model}"',
        "image_size = ({}, {})".format(*camera.image_size),
        f"K = [{K}]",
        f"distortion = [{names}{rows}\n]" if coefficients else "distortion = []",
    ]
    if (correction := camera.correction) is not None:
        high, columns, _ = correction.control.shape
        grid = f"{columns} × {high} control points"
        lines.append(f"# and a smooth correction of {grid}: see the files .json and .cameramodel")
    return "\n".join(lines)


def models(calibration: Calibration) -> list[Model]:
    """The lens models, the chosen one first. They were compared on the same set of corners, weighted as in the fit,
    some of which the final calibration may leave out."""
    return [
        Model(s.model, (multiple(s.rms, calibration.models[0].rms), multiple(s.held_out, calibration.models[0].rms)))
        for s in calibration.models
    ]


def board(calibration: Calibration) -> BoardNumbers:
    """The board's numbers."""
    target, shape = calibration.target, calibration.shape
    shown = Counter(str(v.target or "no codes read") for v in calibration.used_views)
    return BoardNumbers(
        size=calibration.size,
        side="side of a tag" if target is not None and target.kind == "aprilgrid" else "spacing",
        spacing=1000 * calibration.spacing,
        coded=target is not None,
        targets=shown.most_common(),
        orientation=calibration.orientation,
        shape=None if shape is None else {"print_error": 1000 * shape.print_error, "bend": 1000 * shape.bend},
        noise=calibration.noise,
    )
