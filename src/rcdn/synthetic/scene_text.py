"""Scenes from JSON with every field validated, so that the result can be rendered."""

from __future__ import annotations

import dataclasses
import json
from functools import cache
from types import NoneType, UnionType
from typing import Any, Literal, get_args, get_origin, get_type_hints

from rcdn.errors import ConfigError, RcdnError, shown
from rcdn.geometry import lens_trouble
from rcdn.synthetic.background import KINDS
from rcdn.synthetic.scene import Background, Bend, BoardSpec, Cover, Light, Scene, Sensor
from rcdn.types.ranges import BOX

MOST_OBJECTS = 1000
"""largest number of boards, covers, … in a scene"""
ANY, SEEDS, GREY, LIGHT, BLUR = (-1e6, 1e6), (0, 2**64 - 1), (-10, 10), (-20, 20), (0, 100)
RANGES: dict[type, dict[str, tuple[float, float]]] = {
    Scene: {"width": (1, 10_000), "height": (1, 10_000), "focal": (1e-3, 1e7), "seed": SEEDS},
    BoardSpec: {
        "cols": (1, 1000), "rows": (1, 1000), "aspect": (1e-3, 1e3), "margin": (0, 1e3), "margin_value": GREY,
        "black": GREY, "white": GREY, "bleed": (-0.5, 0.5), "coded": (0, 64),
    },
    Bend: {"curvature": (-1e3, 1e3), "amplitude": (-1e3, 1e3), "period": (1e-3, 1e6)},
    Cover: {"radius": (0, 1e6), "value": GREY, "soft": (1e-6, 1e6)},
    Light: {"gx": LIGHT, "gy": LIGHT, "wave": LIGHT, "wave_seed": SEEDS},
    Sensor: {
        "blur": BLUR, "disk": BLUR, "motion": BLUR, "gain": (-1e3, 1e3), "offset": (-1e3, 1e3), "gamma": (0.01, 100),
        "noise": (0, 1e4), "shot": (0, 1e4), "smooth": BLUR, "sharpen": BLUR, "jpeg": (0, 100),
    },
    Background: {"seed": SEEDS, "image": (-1, 2**31)},
}  # fmt: skip
"""valid range of each number; ANY for fields that aren't listed"""
LEAST_GLARE = 1e-3
"""px, smallest sigma of a glare"""


def scene_from_json(text: str) -> Scene:
    """The scene written by `Scene.to_json`. Raises ConfigError, naming the field and its range, for any other text."""
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"scene: this is not a scene written by rcdn, but no JSON: {shown(str(error))}") from error
    scene: Scene = _object(Scene, values, "scene")
    _require(scene.background.kind in (*KINDS, "image"), "scene.background.kind", f"one of {', '.join(KINDS)}, image")
    glares = all(glare[2] >= LEAST_GLARE for glare in scene.light.glares)
    _require(glares, "scene.light.glares", f"x, y, sigma of at least {LEAST_GLARE:g}, strength")
    many = sum(board.cols * board.rows for board in scene.boards)
    _require(many <= BOX, "scene.boards", f"of at most {BOX} corners", many)
    try:
        trouble = lens_trouble(scene.camera)
    except RcdnError as error:
        trouble = str(error)
    if trouble:
        raise ConfigError(f"scene: {trouble}")
    return scene


def _require(ok: bool, where: str, wanted: str, value: Any = ...) -> None:
    if not ok:
        raise ConfigError(f"{where} must be {wanted}" + ("" if value is ... else f", not {shown(value)}"))


@cache
def _kinds(cls: type) -> dict[str, Any]:
    return get_type_hints(cls)


def _object(cls: Any, values: Any, where: str) -> Any:
    """An instance of the dataclass `cls` from a JSON object of its fields."""
    _require(isinstance(values, dict), where, f"an object, a {cls.__name__}", values)
    kinds, fields = _kinds(cls), dataclasses.fields(cls)
    if unknown := sorted(set(values) - set(kinds)):
        raise ConfigError(f"{where}: a {cls.__name__} has no {shown(unknown[0])}; known: {', '.join(kinds)}")
    no_default = dataclasses.MISSING
    needed = [f.name for f in fields if f.default is no_default and f.default_factory is no_default]
    if missing := [name for name in needed if name not in values]:
        raise ConfigError(f"{where}: {missing[0]!r} is missing; give a scene written by rcdn")
    limits = RANGES.get(cls, {})
    found = {k: _value(kinds[k], v, f"{where}.{k}", limits.get(k, ANY)) for k, v in values.items()}
    return cls(**found)


def _value(kind: Any, value: Any, where: str, limits: tuple[float, float]) -> Any:
    """The value of a field of type `kind`, with its numbers checked against `limits`."""
    if dataclasses.is_dataclass(kind):
        return _object(kind, value, where)
    if get_origin(kind) is UnionType:  # optional
        return (
            None
            if value is None
            else _value(next(k for k in get_args(kind) if k is not NoneType), value, where, limits)
        )
    if get_origin(kind) is tuple:
        return _row(get_args(kind), value, where, limits)
    if get_origin(kind) is Literal:
        _require(value in get_args(kind), where, f"one of {', '.join(get_args(kind))}", value)
        return value
    if kind in (int, float):
        return _number(kind, value, where, limits)
    names = {bool: "true or false", str: "text"}
    _require(isinstance(value, kind), where, names[kind], value)
    return value


def _number(kind: Any, value: Any, where: str, limits: tuple[float, float]) -> Any:
    ok = isinstance(value, (int, kind)) and not isinstance(value, bool) and limits[0] <= value <= limits[1]
    _require(ok, where, f"a {'whole ' if kind is int else ''}number in [{limits[0]:g}, {limits[1]:g}]", value)
    return kind(value)


def _row(kinds: tuple[Any, ...], value: Any, where: str, limits: tuple[float, float]) -> tuple[Any, ...]:
    """A tuple: of any length if its type ends in `...`, else with one type per element."""
    any_length = kinds[-1] is Ellipsis
    _require(isinstance(value, list), where, "a list", value)
    if any_length:
        _require(len(value) <= MOST_OBJECTS, where, f"a list of at most {MOST_OBJECTS}", value)
        kinds = kinds[:1] * len(value)
    _require(len(value) == len(kinds), where, f"a list of {len(kinds)}", value)
    return tuple(_value(k, v, f"{where}[{n}]", limits) for n, (k, v) in enumerate(zip(kinds, value, strict=True)))
