"""Detections of Tables 2 and 3, kept between runs, so that an interrupted run can be continued."""

from __future__ import annotations

import contextlib
import hashlib
import json
import platform
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.errors import ConfigError, OutputError
from rcdn.io import write_text
from rcdn.provenance import OPENCV, RUNTIMES, versions
from rcdn.types import Array
from rcdn_lab.paper.sets import Shot

FORM = 1
"""Version of the file format, increased when it changes."""
SOURCES = (
    "config.py", "corners", "geometry", "io", "limits.py", "native.py", "synthetic", "types",
    "rcdn_lab/sweep/pictures.py", "rcdn_lab/paper/score.py", "rcdn_lab/paper/sets.py", "metrics.py",
)  # fmt: skip
"""Parts of the package on which the pictures and the detections in them depend."""
LIBRARIES = ("numpy", "scipy", *OPENCV, "simplejpeg", *RUNTIMES)
FACTS = "settings.json"


def configuration() -> dict[str, Any]:
    """Everything by name on which a detection depends, except network and picture."""
    ours, lab = (Path(str(import_module(name).__file__)).parent for name in ("rcdn", "rcdn_lab"))
    facts: dict[str, Any] = {"form": FORM, "machine": platform.machine()}
    facts |= {f"version of {name}": number for name, number in versions(*LIBRARIES).items()}
    facts["compiled kernels"] = digest(Path(str(import_module("rcdn._native").__file__)))
    parts = {part: lab.parent / part if part.startswith(lab.name) else ours / part for part in SOURCES}
    return facts | {f"source of {part}": digest(path) for part, path in parts.items()}


def digest(path: Path) -> str:
    """sha256 of a source file, or of all source files in a folder."""
    total = hashlib.sha256()
    for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
        total.update(file.relative_to(path.parent).as_posix().encode() + b"\0" + file.read_bytes() + b"\0")
    return total.hexdigest()


@dataclass(frozen=True)
class TableCache:
    """A folder of detections, with a subfolder for each network. Open it by `open_cache`."""

    folder: Path

    def get(self, row: str, shot: Shot, rule: str) -> Array | None:
        """Detections (N, 2) of a network on a picture under a rule, or None."""
        try:
            record = json.loads(self._path(row, shot).read_text())
            if record["picture"] != shot.identity or rule not in record["found"]:
                return None
            return np.array(record["found"][rule], np.int64).reshape(-1, 2)
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def put(self, row: str, shot: Shot, found: dict[str, Array]) -> None:
        """Add detections by rule to the existing ones; the file is written whole or not at all. Raises OutputError."""
        path = self._path(row, shot)
        old: dict[str, Any] = {}
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            record = json.loads(path.read_text())
            old = record["found"] if record["picture"] == shot.identity else {}
        new = {rule: xy.tolist() for rule, xy in found.items()}
        write_text(path, json.dumps({"picture": shot.identity, "found": old | new}))

    def _path(self, row: str, shot: Shot) -> Path:
        return self.folder / row / f"{shot.set}--{shot.name}.json"


def open_cache(folder: Path, networks: dict[str, str]) -> TableCache:
    """The cache in `folder` for `networks` (row → checksum of what determines its detections).

    Raises ConfigError, naming all differences, if it was made with another configuration or other weights; OutputError
    if it cannot be written.
    """
    _agree(folder, configuration(), "name another folder, or delete this one")
    for row, checksum in networks.items():
        _agree(folder / row, {f"weights of {row}": checksum}, f"name another folder, or delete {folder / row}")
    return TableCache(folder)


def _agree(folder: Path, facts: dict[str, Any], fix: str) -> None:
    """Write the facts into an empty folder; in any other, compare them with the stored ones."""
    known = _known(folder, fix)
    if known is None:
        write_text(folder / FACTS, json.dumps(facts, indent=1) + "\n")
        return
    different = [key for key in sorted(facts.keys() | known.keys()) if facts.get(key) != known.get(key)]
    if different:
        differences = ", ".join(
            f"{key} ({_short(known.get(key))} there, {_short(facts.get(key))} now)" for key in different
        )
        raise ConfigError(f"--cache {folder}: made with another configuration: {differences}; {fix}")


def _known(folder: Path, fix: str) -> dict[str, Any] | None:
    """The facts with which a folder was made; None for an empty one, which is created if it does not exist."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        text = (folder / FACTS).read_text() if (folder / FACTS).exists() else None
        others = [p.name for p in folder.iterdir() if not p.name.startswith(".")]
    except OSError as error:
        raise OutputError(f"--cache {folder}: can't be used ({error.strerror}); name another folder") from error
    if text is None:
        if others:
            raise ConfigError(f"--cache {folder}: the folder holds something else ({others[0]}); name an empty one")
        return None
    try:
        return dict(json.loads(text))
    except (ValueError, TypeError) as error:
        raise ConfigError(f"--cache {folder}: {FACTS} in it can't be read; {fix}") from error


def _short(value: Any) -> str:
    return "nothing" if value is None else str(value)[:12]
