"""Commands to be disturbed: what they start from, and what they leave.

A home is a folder with small pictures of boards. A command has a folder `out` in it, whose bytes are those of a run
that nobody disturbed, or what was there before, and in the end, when it is run again, always the former.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from rcdn.io import write_image
from rcdn.synthetic import BoardSpec, Scene, render

TILTS = (((0.5, 0), (-3, -2)), ((0, 0.5), (-2, -1)), ((-0.4, 0.3), (-4, -3)), ((0.4, 0.4), (-3, -1)))
OLD = b"what was here before\n"
_CLOCK = re.compile(rb"Made by rcdn [^<]* UTC")
"""what a report says of its day and its commit"""
TINY = """
architecture = "A"
side = 54
batch = 3
steps = 4
validate_every = 1
[pool]
count = 4
size = 64
ranges = "ordinary"
backgrounds = "none"
"""
TRAIN = """
import sys
from rcdn import interrupts
if __name__ == "__main__":
    interrupts.install()
    try:
        from rcdn.training import validate
        crops = validate.validation_set.__wrapped__(2)
        validate.validation_set = lambda: crops
    except KeyboardInterrupt:
        sys.exit(130)
    from rcdn.__main__ import main
    main()
"""


def make_home(folder: Path) -> Path:
    """`folder` with four pictures, each of a board of 7 × 5 corners, and a training that takes a moment."""
    for k, (tilt, at) in enumerate(TILTS):
        scene = Scene(320, 240, 300.0, (159.5, 119.5), boards=(BoardSpec(7, 5, (*tilt, 0.1 * k), (*at, 13.0)),), seed=k)
        write_image(folder / "in" / f"{k}.png", render(scene))
    (folder / "tiny.toml").write_text(TINY.replace('"none"', '""'))
    (folder / "train.py").write_text(TRAIN)
    return folder


# ---- commands


@dataclass(frozen=True)
class Command:
    """`words` after the interpreter; `stale`: files that were there before; `partial`: what Ctrl-C may leave of a file
    beside its whole bytes; `keeps`: what stays when all else is made anew."""

    name: str
    words: tuple[str, ...]
    stale: tuple[str, ...]
    partial: Callable[[str, bytes, bytes], bool] = lambda name, data, whole: False
    keeps: str = ""


def _lines_of(name: str, data: bytes, whole: bytes) -> bool:
    """Ctrl-C writes the pictures that were done: whole lines of the whole file."""
    if not name.endswith((".json", ".vnl")):
        return False
    clean = {line.rstrip(b",") for line in whole.splitlines()}
    lines = [line.rstrip(b",") for line in data.splitlines()]
    return all(line in clean or line in (b'{"version": 1, "images": [], "errors": []}',) for line in lines)


DETECT = Command(
    "detect",
    ("-m", "rcdn", "detect", "in", "--json", "out/found.json", "--vnl", "out/found.vnl", "--overlay", "out/see",
     "--cache", "out/kept", "-j", "2"),
    ("found.json", "found.vnl", "see/1.png"),
    _lines_of,
)  # fmt: skip
CALIBRATE = Command(
    "calibrate",
    ("-m", "rcdn", "calibrate", "in", "--spacing", "25mm", "--model", "pinhole", "--flat", "-o", "out/camera.yaml",
     "--force", "--report", "out/report.html", "--json", "out/camera.json", "--cache", "out/kept", "-j", "2"),
    ("camera.yaml", "report.html", "camera.json"),
    keeps="kept",
)  # fmt: skip
TRAINING = Command(
    "train",
    ("train.py", "train", "tiny.toml", "--runs", "out", "--threads", "1", "--workers", "1", "--accelerator", "cpu",
     "--devices", "1"),
    (),
)  # fmt: skip
ALONE = replace(DETECT, name="detect --jobs 1", words=(*DETECT.words[:-1], "1"))


def heed_ctrl_c() -> None:
    """Have processes that this one starts heed Ctrl-C, also if it runs in the background of a shell,
    where it and all of them would ignore it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def start(command: Command, home: Path) -> subprocess.Popen[str]:
    """The command in a session of its own, as a terminal starts it."""
    return subprocess.Popen(
        [sys.executable, *command.words], cwd=home, text=True, start_new_session=True, stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=os.environ | {"OMP_NUM_THREADS": "1"},
    )  # fmt: skip


def fresh(command: Command, home: Path, everything: bool = False) -> None:
    """Nothing but old outputs, and, unless `everything` goes, what the command keeps from run to run."""
    for path in (home / "out").glob("*"):
        if everything or path.name != command.keeps:
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    for name in command.stale:
        (home / "out" / name).parent.mkdir(parents=True, exist_ok=True)
        (home / "out" / name).write_bytes(OLD)


def contents(command: Command, home: Path) -> dict[str, bytes]:
    """What the command left: name → bytes; of a training what doesn't tell of time."""
    files = {str(p.relative_to(home / "out")): p for p in (home / "out").rglob("*") if p.is_file()}
    if command is not TRAINING:
        return {name: _CLOCK.sub(b"", p.read_bytes()) for name, p in files.items()}
    found = {}
    for name, path in files.items():
        if "events" in path.parts:
            continue
        found[name] = _timeless(path)
    return found


def contents_at_once(command: Command, home: Path) -> dict[str, bytes]:
    """`contents`, of a training only the names: its files grow."""
    if command is not TRAINING:
        return contents(command, home)
    files = (p for p in (home / "out").rglob("*") if p.is_file() and "events" not in p.parts)
    return {str(p.relative_to(home / "out")): b"" for p in files}


def _timeless(path: Path) -> bytes:
    """The content of a file of a training without its seconds, its commit and its machine."""
    if path.name == "metrics.csv":
        rows = [line.split(",") for line in path.read_text().splitlines()]
        at = rows[0].index("seconds")
        return "\n".join(",".join(row[:at] + row[at + 1 :]) for row in rows).encode()
    if path.name == "run.json":
        import json

        facts = json.loads(path.read_text())
        return json.dumps([facts["config"], facts["metrics"] | {"seconds": 0}]).encode()
    if path.name == "last.pt":
        import torch

        state = torch.load(path, weights_only=True)
        tensors = [*state["model"].items(), *state["ema"].items()]
        return b"".join(name.encode() + value.numpy().tobytes() for name, value in tensors) + b"%d" % state["step"]
    return path.read_bytes()
