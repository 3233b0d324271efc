"""The weights of the paper's tables: each a network of configs/tables, trained by `rcdn train` (docs/training.md)."""

from __future__ import annotations

from importlib.resources import files

from rcdn.corners.response import ResponseModel, load_model

TABLES = "tables/"
"""what names of them begin with"""


def weights_path(name: str) -> str:
    """What `load_model` takes for `name`: `tables/x`, made by configs/tables/x.toml, is a file here; other names are themselves."""
    if not name.startswith(TABLES) or name.endswith(".onnx"):
        return name
    return str(files(__name__) / f"{name.removeprefix(TABLES)}.onnx")


def load_network(name: str) -> ResponseModel:
    """`load_model`, of `tables/x`, too."""
    return load_model(weights_path(name))
