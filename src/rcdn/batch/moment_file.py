"""The file of `--moments`: pictures of a rig's cameras that were taken at the same moment, one moment per line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Annotated

import typer

from rcdn.batch.pair_file import Named, lines_with_fields, refuse_lines
from rcdn.errors import ConfigError

Moments = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="With --rig: which pictures belong together, a line for each moment: the name of each camera's picture, "
        "in the order of the inputs, or - for none.",
    ),
]
NONE = ("", "-")
"""fields of a camera that has no picture of a moment"""


@dataclass(frozen=True)
class MomentFile:
    """A file of moments: its `path`, and for each line with names its number, from 1, and its fields."""

    path: Path
    lines: tuple[tuple[int, tuple[str, ...]], ...]

    @classmethod
    def read(cls, path: Path) -> MomentFile:
        """Read one moment per line, written as the pairs of `PairFile`, with a name or `-` for each camera. Raises
        ConfigError if the file can't be read, or has no such line."""
        lines = tuple((number, tuple(names)) for number, _, names in lines_with_fields(path, "--moments"))
        if not lines:
            raise _none(path)
        return cls(path, lines)

    def match(
        self, pictures: Mapping[str, Sequence[str]], unread: Mapping[str, Sequence[str]] | None = None
    ) -> list[list[str]]:
        """For each camera the moments of its `pictures`: the number of the line that names one, else a number of its
        own, since it may still tell about the lens.

        Fields are in the order of the cameras, unless the first line names these in another one. Names match as those
        of `PairFile` do; a camera's pictures that are `unread` (already reported) are skipped. Raises ConfigError that
        lists every line with another number of fields, with an unknown or ambiguous name, or with a picture of another
        line.
        """
        order, lines = self._header(list(pictures))
        named = {camera: Named(of_camera, self.path.parent) for camera, of_camera in pictures.items()}
        lost = {camera: Named((unread or {}).get(camera, ()), self.path.parent) for camera in order}
        found: dict[str, dict[int, int]] = {camera: {} for camera in order}
        bad = []
        for number, names in lines:
            if len(names) != len(order):
                bad.append((number, f"must hold {len(order)} names, one for each camera, or -, not {len(names)}"))
                continue
            faults = []
            for camera, name in zip(order, names, strict=True):
                if name in NONE or lost[camera].matching(name):
                    continue
                at, fault = _find(name, camera, named[camera])
                if at in found[camera]:
                    fault = f"{name} is in line {found[camera][at]}, too"
                if fault:
                    faults.append(fault)
                else:
                    found[camera][at] = number
            if faults:
                bad.append((number, " and ".join(faults)))
        refuse_lines(self.path, bad)
        own = count(self.lines[-1][0] + 1)
        return [
            [str(found[camera][k] if k in found[camera] else next(own)) for k in range(len(names))]
            for camera, names in pictures.items()
        ]

    def _header(self, cameras: list[str]) -> tuple[list[str], tuple[tuple[int, tuple[str, ...]], ...]]:
        """The cameras in the order of the fields, and the lines without the one that names cameras."""
        first = list(self.lines[0][1])
        if sorted(first) != sorted(cameras):
            return cameras, self.lines
        if len(self.lines) == 1:
            raise _none(self.path)
        return first, self.lines[1:]


def _find(name: str, camera: str, named: Named) -> tuple[int, str]:
    """(index, "") of the picture of a camera that is called `name`, or (−1, description of the fault)."""
    found, pictures = named.matching(name), named.pictures
    if len(found) == 1:
        return found[0], ""
    if found:
        return -1, f"{name} may be {' and '.join(pictures[k] for k in found[:2])}: write more of the folder"
    example = f", such as {pictures[0]}" if pictures else ""
    return -1, f"no picture of {camera} is called {name} (it has {len(pictures)}{example})"


def _none(path: Path) -> ConfigError:
    return ConfigError(
        f"--moments {path}: holds no moments; write a line for each: the name of each camera's picture, or -"
    )
