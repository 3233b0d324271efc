"""The weights of the paper's tables: networks of configs/tables, trained by `rcdn train` (docs/training.md)."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

from rcdn.corners.response import ResponseModel, load_model
from rcdn.errors import RcdnError

TABLES = "tables/"
"""prefix of their names: `tables/x` is made by configs/tables/x.toml"""
FOLDER: Any = files(__name__)


def lacking(name: str) -> str | None:
    """The first absent file of the weights `tables/x`, such as tables/x.onnx; None if there are both."""
    for ending in (".onnx", ".json"):
        if not (FOLDER / (name.removeprefix(TABLES) + ending)).is_file():
            return name + ending
    return None


def load_network(name: str) -> ResponseModel:
    """`load_model`, also for `tables/x`; its error names those weights, not their place on this machine."""
    if not name.startswith(TABLES) or name.endswith(".onnx"):
        return load_model(name)
    if absent := lacking(name):
        raise RcdnError(f"model: no weights {absent}: rcdn train configs/{name}.toml makes them")
    return load_model(str(FOLDER / f"{name.removeprefix(TABLES)}.onnx"))
