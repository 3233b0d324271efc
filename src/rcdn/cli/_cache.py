"""Detections kept from one run to the next: one small file a picture, named by all that determines the result."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
import platform
import secrets
import sys
import time
import zlib
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rcdn.errors import OutputError, RcdnError

if TYPE_CHECKING:
    from rcdn.config import DetectorConfig
    from rcdn.io import ImageResult

FORM = "1"
"""Raised when the entries change their form."""
LIMIT = 500_000_000
"""Bytes of entries that `prune` leaves."""
STALE = 86_400.0
"""Seconds after which a temporary file belongs to a run that was killed."""
NOT_DETECTION = frozenset({"cli", "report", "evaluation", "training", "peers", "synthetic", "calibration"})
"""Parts of the package that can't change what is found in a picture."""
_LIBRARIES = ("numpy", "scipy", "cv2", "onnxruntime")


def default_folder() -> Path:
    """Where this system keeps what may be deleted at any time."""
    if os.name == "nt":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "rcdn"


def fingerprint(config: DetectorConfig, package: Path | None = None) -> str:
    """Checksum of all but the picture that determines a result: settings, weights, code, libraries, machine.

    `package`: the folder whose sources count; None: that of rcdn. Raises RcdnError if the weights can't be read.
    """
    from rcdn.corners.response import load_model

    package = package or Path(__file__).parents[1]
    model = load_model(config.model)
    parts = [FORM, replace(config, threads=0).to_json(), platform.machine()]
    parts += [f"{name} {import_module(name).__version__}" for name in _LIBRARIES]
    digest = hashlib.sha256("\n".join(parts).encode())
    for piece in (model.data, json.dumps(model.facts, sort_keys=True).encode()):
        digest.update(hashlib.sha256(piece).digest())
    for source in sorted(package.rglob("*.py")):
        inside = source.relative_to(package)
        if inside.parts[0] not in NOT_DETECTION:
            digest.update(f"{inside.as_posix()} {file_digest(source)}".encode())
    return digest.hexdigest()


def file_digest(path: str | Path) -> str:
    """sha256 of a file's content. Raises OSError."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass(frozen=True)
class Cache:
    """A folder of results. `salt`: the `fingerprint` of whatever makes them.

    No method fails on account of the disk: what can't be read, or is damaged, is not there; what can't be written is
    computed again the next time. Several processes may share a folder.
    """

    folder: Path
    salt: str

    def key(self, content: str, *more: object) -> str:
        """The name of an entry: `content`, checksum of the file; `more`: which part of it, or what else was asked."""
        return hashlib.sha256("\n".join(map(str, (self.salt, content, *more))).encode()).hexdigest()

    def get(self, key: str) -> Any:
        """What `put` stored, or None."""
        path = self._path(key)
        try:
            check, _, text = path.read_bytes().partition(b"\n")
            if int(check, 16) != zlib.crc32(text):
                return None
            value = json.loads(text)
            os.utime(path)  # what is used stays
        except (OSError, ValueError, RecursionError):
            return None
        return value

    def put(self, key: str, value: Any) -> None:
        """Store plain `value` (lists, dictionaries, texts, numbers, NaN too): the whole entry or none."""
        text = json.dumps(value, separators=(",", ":")).encode()
        path = self._path(key)
        temporary = path.with_name(f".{secrets.token_hex(8)}.tmp")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary.write_bytes(b"%08x\n" % zlib.crc32(text) + text)
            os.replace(temporary, path)
        except OSError:
            _remove(temporary)
        except BaseException:
            _remove(temporary)
            raise

    def result(self, key: str, name: str) -> ImageResult | None:
        """The detections stored under `key`, for the picture called `name`; None if there are none."""
        value = self.get(key)
        try:
            return None if value is None else _unpack(value, name)
        except (KeyError, TypeError, ValueError, RcdnError):
            return None

    def keep(self, key: str, result: ImageResult) -> None:
        """Store the detections of one picture, every number exactly."""
        self.put(key, _pack(result))

    def prune(self, limit: int = LIMIT) -> None:
        """Delete the entries that nobody used for longest until at most `limit` bytes are left, and what killed runs left."""
        entries = []
        for path in self._root.glob("??/*"):
            with contextlib.suppress(OSError):
                stat = path.stat()
                if path.suffix == ".json":
                    entries.append((stat.st_mtime, str(path), stat.st_size))
                elif path.suffix == ".tmp" and time.time() - stat.st_mtime > STALE:
                    _remove(path)
        total = sum(size for _, _, size in entries)
        for _, name, size in sorted(entries):
            if total <= limit:
                break
            _remove(Path(name))
            total -= size

    @property
    def _root(self) -> Path:
        return self.folder / "detections"  # a folder of our own: the user may have named one with other files

    def _path(self, key: str) -> Path:
        return self._root / key[:2] / f"{key}.json"


def open_cache(config: DetectorConfig, folder: Path | None = None, off: bool = False) -> Cache | None:
    """The cache for detections with `config`, in `folder` or, without one, where the system keeps such things.

    None if `off`. Raises OutputError if `folder` was named and can't be written, RcdnError if the weights can't be read.
    """
    if off:
        return None
    if folder is not None:
        _check_folder(folder)
    return Cache(folder or default_folder(), fingerprint(config))


def _check_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"--cache {folder}: no folder can be made there ({error.strerror}); name another") from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"--cache {folder}: the folder may not be written; name another, or use --no-cache")


def _remove(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink()


# ---- results → plain values → results; all digits, unlike the file of detections


def _pack(result: ImageResult) -> dict[str, Any]:
    size = {"width": int(result.width), "height": int(result.height)}
    found = {"corners": _plain(result.corners), "boards": [_plain(b) for b in result.boards]}
    return size | found | {"warnings": list(result.warnings)}


def _plain(value: Any) -> dict[str, Any]:
    """The fields of Corners or of a Board, arrays as lists."""
    pairs = ((f.name, getattr(value, f.name)) for f in dataclasses.fields(value))
    return {name: v.tolist() if hasattr(v, "tolist") else v for name, v in pairs}


def _unpack(record: Any, name: str) -> ImageResult:
    from rcdn.io import ImageResult
    from rcdn.types import Board, Corners

    boards = [Board(**b | {"image_size": tuple(b["image_size"])}) for b in record["boards"]]
    corners, warnings = Corners(**record["corners"]), tuple(map(str, record["warnings"]))
    return ImageResult(name, record["width"], record["height"], corners, tuple(boards), warnings)
