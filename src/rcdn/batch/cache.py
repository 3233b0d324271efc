"""Cache of detections between runs: one small file for each picture, named by a checksum of all that determines the
result."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
import platform
import sys
import time
import zlib
from importlib import import_module, machinery
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from rcdn.errors import ConfigError, OutputError, RcdnError

if TYPE_CHECKING:
    from rcdn.config import DetectorConfig
    from rcdn.io import ImageResult

FORM = "2"
"""Version of the entries' format; increased when the format changes."""
LIMIT = 500_000_000
"""Total size of the entries that `prune` keeps, in bytes."""
STALE = 86_400.0
"""Age in seconds above which a temporary file is assumed to belong to a run that was killed."""
NOT_DETECTION = frozenset({
    "adapters.py", "calibration", "cli", "live", "opencv.py", "report", "synthetic", "terminal", "training",
})  # fmt: skip
"""Parts of the package that can't change the detections of a picture."""
_LIBRARIES = ("numpy", "scipy", "cv2")
_SOURCES = (".py", *machinery.EXTENSION_SUFFIXES)


def default_folder() -> Path:
    """The system's folder for cached data, which may be deleted at any time. Raises RuntimeError if the user has no
    home folder."""
    if os.name == "nt":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "rcdn"


def _versions() -> list[str]:
    from rcdn.provenance import RUNTIMES, versions

    found = [f"{name} {import_module(name).__version__}" for name in _LIBRARIES]
    return found + [f"{name} {number}" for name, number in versions("simplejpeg", *RUNTIMES).items()]


def fingerprint(config: DetectorConfig, package: Path | None = None) -> str:
    """Checksum of everything except the picture that determines a result: settings, weights, code and compiled kernels,
    library versions, and the machine's architecture.

    `package`: the folder whose code is included; None: that of rcdn. Raises RcdnError if the weights can't be read.
    """
    from rcdn.corners.response import load_model

    package = package or Path(__file__).parents[1]
    model = load_model(config.weights)
    parts = [FORM, dataclasses.replace(config, threads=0).to_json(), platform.machine()]
    parts += _versions()
    digest = hashlib.sha256("\n".join(parts).encode())
    for piece in (model.data or b"", json.dumps(model.facts, sort_keys=True).encode()):
        digest.update(hashlib.sha256(piece).digest())
    for source in sorted(package.rglob("*")):
        inside = source.relative_to(package)
        if source.name.endswith(_SOURCES) and inside.parts[0] not in NOT_DETECTION:
            digest.update(f"{inside.as_posix()} {file_digest(source)}".encode())
    return digest.hexdigest()


def file_digest(path: str | Path) -> str:
    """sha256 of a file's content. Raises OSError."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclasses.dataclass(frozen=True)
class Cache:
    """A folder of cached results. `salt`: the `fingerprint` of the detector that computes them.

    No method raises an error of the file system: an entry that can't be read or is damaged counts as missing; one that
    can't be written is computed again in the next run. Several processes may share a folder.
    """

    folder: Path
    salt: str

    def key(self, content: str, *more: object) -> str:
        """The key of an entry. `content`: checksum of the input file; `more`: the part of the file, or other parameters
        of the request."""
        return hashlib.sha256("\n".join(map(str, (self.salt, content, *more))).encode()).hexdigest()

    def get(self, key: str) -> Any:
        """The value that `put` stored under `key`, or None if there is no valid entry."""
        path = self._path(key)
        try:
            check, _, text = path.read_bytes().partition(b"\n")
            if int(check, 16) != _checksum(key, text):
                return None
            value = json.loads(text)
            os.utime(path)  # marks it as recently used, so that `prune` keeps it
        except (OSError, ValueError, RecursionError):
            return None
        return value

    def put(self, key: str, value: Any) -> None:
        """Store `value` (lists, dictionaries, strings, numbers, NaN included). The entry is written whole or not at
        all."""
        from rcdn.io import whole

        text = json.dumps(value, separators=(",", ":")).encode()
        path = self._path(key)
        with contextlib.suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            whole.replace(path, (b"%08x\n" % _checksum(key, text) + text,), durable=False)

    def result(self, key: str, name: str) -> ImageResult | None:
        """The detections stored under `key`, for the picture called `name`; None if there are none."""
        value = self.get(key)
        try:
            return None if value is None else unpacked(value, name)
        except (ArithmeticError, KeyError, TypeError, ValueError, RcdnError):
            return None

    def keep(self, key: str, result: ImageResult) -> None:
        """Store the detections of one picture, every number exactly."""
        self.put(key, packed(result))

    def prune(self, limit: int = LIMIT) -> None:
        """Delete the least recently used entries until at most `limit` bytes are left, and temporary files of killed
        runs."""
        entries = []
        for path in self._root.glob("??/*"):
            with contextlib.suppress(OSError):
                stat = path.stat()
                if path.suffix == ".json":
                    entries.append((stat.st_mtime, str(path), stat.st_size))
                elif path.suffix in (".tmp", ".part") and time.time() - stat.st_mtime > STALE:
                    _remove(path)
        total = sum(size for _, _, size in entries)
        for _, name, size in sorted(entries):
            if total <= limit:
                break
            _remove(Path(name))
            total -= size

    @property
    def _root(self) -> Path:
        return self.folder / "detections"  # a subfolder: the folder that the user named may contain other files

    def _path(self, key: str) -> Path:
        return self._root / key[:2] / f"{key}.json"


def packed(result: ImageResult) -> dict[str, Any]:
    """`result` as plain values with all digits (the file of detections rounds them): lists, dictionaries, strings and
    numbers."""
    size = {"width": int(result.width), "height": int(result.height)}
    found = {"corners": _plain(result.corners), "boards": [_plain(b) for b in result.boards]}
    return size | found | {"warnings": list(result.warnings)}


def _plain(value: Any) -> dict[str, Any]:
    """The fields of Corners or of a Board, arrays as lists."""
    from rcdn.types.target import target_record

    pairs = [(f.name, getattr(value, f.name)) for f in dataclasses.fields(value)]
    pairs = [(name, target_record(v) if name == "target" and v is not None else v) for name, v in pairs]
    return {name: v.tolist() if hasattr(v, "tolist") else v for name, v in pairs}


def unpacked(record: Any, name: str) -> ImageResult:
    """The inverse of `packed`. Raises errors of several types if `record` has another structure, or values that no
    detection has: the types check their ranges, and this function the further conditions on detections."""
    import numpy as np

    from rcdn.io import ImageResult
    from rcdn.types import Board, Corners
    from rcdn.types.target import target_of

    read = lambda target: None if target is None else target_of(target)  # noqa: E731
    corners = Corners(**record["corners"])
    boards = tuple(Board(**board | {"target": read(board["target"])}) for board in record["boards"])
    if not all(np.isfinite(xy).all() for xy in (corners.xy, *(board.xy for board in boards))):
        raise ValueError("no positions")
    if not all((board.ij >= 0).all() for board in boards):
        raise ValueError("no labels")
    warnings = record["warnings"]
    if not isinstance(warnings, list) or not all(isinstance(text, str) for text in warnings):
        raise ValueError("no warnings")
    return ImageResult(name, record["width"], record["height"], corners, boards, tuple(warnings))


def open_cache(config: DetectorConfig, folder: Path | None = None, off: bool = False) -> Cache | None:
    """The cache for detections with `config`, in `folder` or, without one, in the system's cache folder.

    None if `off`; also None, with a note on stderr, if there is no such folder (the user of a container may have no
    home folder). Raises OutputError if `folder` was given and can't be written, RcdnError if the weights can't be read,
    ConfigError for a `folder` if `off`.
    """
    if off and folder is not None:
        raise ConfigError("--cache and --no-cache contradict each other; leave one of them out")
    if off:
        return None
    if folder is not None:
        _check_folder(folder)
    else:
        try:
            folder = default_folder()
        except RuntimeError:
            typer.echo(
                "note: this user has no home folder; what is found is kept for the next run only with --cache DIR",
                err=True,
            )
            return None
    return Cache(folder, fingerprint(config))


def _check_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"--cache {folder}: no folder can be made there ({error.strerror}); name another") from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"--cache {folder}: the folder may not be written; name another, or use --no-cache")


def _checksum(key: str, text: bytes) -> int:
    """Checksum of an entry's text and key: an entry stored under the wrong name is invalid."""
    return zlib.crc32(text, zlib.crc32(key.encode()))


def _remove(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink()
