"""mrgingham, the Debian program: it supports square boards of a given size only, and is therefore given pictures of its
own."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

import cv2
import numpy as np

from rcdn.types import Array
from rcdn_lab.peers.base import Grid, Peer, lattice

SIDE = 7


def _missing() -> str | None:
    return None if shutil.which("mrgingham") else "not installed: apt install mrgingham"


def _version() -> str:
    """From Debian's package manager, because the program does not report it."""
    try:
        done = subprocess.run(
            ["dpkg-query", "-W", "-f", "${Version}", "mrgingham"], capture_output=True, text=True, check=True
        )
        return done.stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "?"


def _find(image: Array, size: tuple[int, int]) -> list[Grid]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        cv2.imwrite(str(path), image)
        command = ["mrgingham", "--jobs", "1", "--gridn", str(size[0]), str(path)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    return _read(done.stdout, size)


def _read(text: str, size: tuple[int, int]) -> list[Grid]:
    """Parse the table `# filename x y level`, a line for each corner, row by row; `- - -` if there is no board."""
    lines = [line.split() for line in text.splitlines() if line and not line.startswith("#")]
    spots = [(float(x), float(y)) for _, x, y, *_ in lines if x != "-"]
    return [Grid(np.array(spots), lattice(size))] if len(spots) == size[0] * size[1] else []


MRGINGHAM = Peer("mrgingham", "given", _missing, _version, lambda: _find, board=(SIDE, SIDE))
