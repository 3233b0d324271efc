"""The weights of the paper's tables: networks of configs/tables, trained by `rcdn train` (docs/training.md)."""

from __future__ import annotations

from importlib.resources import files

from rcdn.corners.response import ResponseModel, load_model

TABLES = "tables/"
"""prefix of their names"""


def weights_path(name: str) -> str:
    """The argument of `load_model` for `name`: `tables/x`, made by configs/tables/x.toml, is a file here; other names
    are unchanged."""
    if not name.startswith(TABLES) or name.endswith(".onnx"):
        return name
    return str(files(__name__) / f"{name.removeprefix(TABLES)}.onnx")


def load_network(name: str) -> ResponseModel:
    """`load_model`, also for `tables/x`."""
    return load_model(weights_path(name))
