"""Sets of pictures from one camera, and the board that they show."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from rcdn.errors import ConfigError
from rcdn.types import CameraModel

ENDINGS = frozenset({".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm"})


@dataclass(frozen=True)
class CameraSet:
    """Pictures of one camera at one zoom: `pattern` in the data folder; `size` (columns, rows) of their board in inner
    corners; the lens `model` fitted to the corners of all detectors."""

    name: str
    pattern: str
    size: tuple[int, int]
    model: CameraModel = "brown"

    def files(self, data: Path) -> list[Path]:
        """The pictures, by name. Raises ConfigError if there are none."""
        found = sorted(p for p in data.glob(self.pattern) if p.suffix.lower() in ENDINGS)
        if not found:
            raise ConfigError(
                f"set {self.name}: no picture matches {self.pattern} in {data}; name the folder of the sets"
            )
        return found


SETS = (
    CameraSet("opencv-left", "opencv-left-right/left*", (9, 6)),
    CameraSet("opencv-right", "opencv-left-right/right*", (9, 6)),
    CameraSet("dreameer-left", "dreameer-qvga/left*", (7, 5)),
    CameraSet("dreameer-right", "dreameer-qvga/right*", (7, 5)),
    CameraSet("oldvga-left", "dreameer-old-vga/*left*", (7, 5)),
    CameraSet("oldvga-right", "dreameer-old-vga/*right*", (7, 5)),
    CameraSet("stereo1-left", "sourishg-stereo1/*left*", (9, 6)),
    CameraSet("stereo1-right", "sourishg-stereo1/*right*", (9, 6)),
    CameraSet("trinocular-left", "boof-trinocular/left*", (13, 9)),
    CameraSet("trinocular-middle", "boof-trinocular/middle*", (13, 9)),
    CameraSet("trinocular-right", "boof-trinocular/right*", (13, 9)),
    CameraSet("bouguet", "bouguet-matlab/*", (13, 12)),
    CameraSet("logicool", "logicool-webcam/*", (10, 7)),
    CameraSet("pseye", "pseye-webcam/*", (10, 7)),
    CameraSet("bimalka", "bimalka-webcam/*", (9, 7)),
    CameraSet("firiceguo", "firiceguo-webcam/*", (7, 7)),
    CameraSet("sony-hx5v", "boof-sony-hx5v/*", (6, 4)),
    CameraSet("udacity-lane", "udacity-lane/*", (9, 6)),
    CameraSet("lim-wide", "lim-robot-wide/*", (8, 6), "fisheye"),
    CameraSet("udacity-wide", "udacity-wide-gopro/*", (8, 6), "fisheye"),
    CameraSet("gopro", "rochade-gopro-a/*", (9, 6)),
    CameraSet("ocam-fish1", "ocam-fish1/*", (8, 6), "fisheye"),
    CameraSet("theta", "boof-fisheye-theta/*", (6, 4), "fisheye"),
    CameraSet("sourishg-left", "sourishg-fisheye/*left*", (9, 6), "fisheye"),
    CameraSet("sourishg-right", "sourishg-fisheye/*right*", (9, 6), "fisheye"),
)
"""Public sets of photographs of one board each (docs/calibration-results.md gives their sources)."""


def parse(text: str) -> CameraSet:
    """A set from `NAME:PATTERN:COLUMNSxROWS[:MODEL]`. Raises ConfigError with the reason."""
    name, _, rest = text.partition(":")
    pattern, _, rest = rest.partition(":")
    size, _, model = rest.partition(":")
    sides = re.fullmatch(r"(\d+)x(\d+)", size)
    if not (name and pattern and sides):
        raise ConfigError(f"--set {text!r}: write NAME:PATTERN:COLUMNSxROWS:MODEL, as in 'left:stereo/left*:9x6:brown'")
    models = tuple(m for m in get_args(CameraModel) if m != "division")
    if (model or "brown") not in models:
        raise ConfigError(f"--set {text!r}: the model must be one of {', '.join(models)}, not {model!r}")
    cols, rows = (int(v) for v in sides.groups())
    if min(cols, rows) < 3:
        raise ConfigError(f"--set {text!r}: a board has at least 3×3 inner corners")
    return CameraSet(name, pattern, (cols, rows), model or "brown")  # type: ignore[arg-type]


def chosen(texts: Sequence[str]) -> list[CameraSet]:
    """The sets that `texts` name or describe; if empty, all known sets. Raises ConfigError for an unknown name."""
    known = {s.name: s for s in SETS}
    unknown = [t for t in texts if ":" not in t and t not in known]
    if unknown:
        raise ConfigError(f"--set: no set is called {', '.join(unknown)}; known: {', '.join(known)}")
    sets = [parse(t) if ":" in t else known[t] for t in texts] or list(SETS)
    twice = sorted({s.name for s in sets if sum(s.name == other.name for other in sets) > 1})
    if twice:
        raise ConfigError(f"--set: two sets are called {', '.join(twice)}; give them different names")
    return sets
