"""Has every function of rcdn whose annotations give shapes of arrays check them, in this process:
`install()` before rcdn is imported.

`Real[Array, "n 2"]` (`rcdn.types.arrays`) is read as jaxtyping's, and checked by beartype.
Functions without shapes stay as they are.
"""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import inspect
import re
import sys
from typing import Any

import jaxtyping
import numpy as np
from beartype import BeartypeConf, beartype

SHAPES = re.compile(r"\b(?:Bool|Real|Int|Shaped)\[Array")
KINDS = {name: getattr(jaxtyping, name) for name in ("Bool", "Int", "Shaped")} | {"Array": np.ndarray}
KINDS["Real"] = jaxtyping.Shaped  # truth values count as 0 and 1
checked: set[str] = set()
"""the functions that check"""


def install() -> None:
    """From now on, modules of rcdn are checked as they are imported."""
    if any(name == "rcdn" or name.startswith("rcdn.") for name in sys.modules):
        raise RuntimeError("rcdn is imported already")
    sys.meta_path.insert(0, _Finder())


class _Finder(importlib.abc.MetaPathFinder):
    def find_spec(self, name: str, path: Any, target: Any = None) -> Any:
        if not name.startswith("rcdn."):
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        if spec is not None and isinstance(spec.loader, importlib.machinery.SourceFileLoader):
            spec.loader = _Loader(spec.loader.name, spec.loader.path)
        return spec


class _Loader(importlib.machinery.SourceFileLoader):
    def exec_module(self, module: Any) -> None:
        super().exec_module(module)
        for owner in (module, *(c for c in vars(module).values() if inspect.isclass(c))):
            if owner is module or owner.__module__ == module.__name__:
                _check_all(owner, module)


def _check_all(owner: Any, module: Any) -> None:
    """Replace the functions of a module or class that state shapes; static and class methods are left out."""
    for name, function in list(vars(owner).items()):
        if inspect.isfunction(function) and function.__module__ == module.__name__:
            stated = _stated(function, vars(module))
            if stated:
                function.__annotations__ = stated
                checked.add(f"{module.__name__}.{function.__qualname__}")
                setattr(owner, name, jaxtyping.jaxtyped(function, typechecker=beartype(conf=BeartypeConf())))


def _stated(function: Any, names: dict[str, Any]) -> dict[str, Any]:
    """The annotations of a function that give shapes, evaluated."""
    hints = {k: v for k, v in function.__annotations__.items() if isinstance(v, str) and SHAPES.search(v)}
    found = {}
    for name, hint in hints.items():
        try:
            found[name] = eval(hint, names | KINDS)
        except NameError:  # beside the shape, a name that is imported for type checkers only
            continue
    return found
