"""Commands that are disturbed: real processes, killed at some moment, and what must hold of all that they leave.

A home is a folder with small pictures of boards. A command has a folder `out` in it, whose bytes are those of a run that nobody disturbed,
or what was there before, and in the end, when it is said again, always the former.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from rcdn.io import write_image
from rcdn.synthetic import BoardSpec, Scene, render

TILTS = (((0.5, 0), (-3, -2)), ((0, 0.5), (-2, -1)), ((-0.4, 0.3), (-4, -3)), ((0.4, 0.4), (-3, -1)))
OLD = b"what was here before\n"
_CLOCK = re.compile(rb"Made by rcdn [^<]* UTC")
"""what a report says of its day and its commit"""
PATIENCE = 20.0
"""seconds that processes have to end in after the first one; workers of a training take 5 to see it"""
LIMIT = 300.0
"""seconds after which a run hangs"""
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
    """`words` after the interpreter; `stale`: files that were there before; `partial`: what Ctrl-C may leave of a file beside its whole bytes;
    `keeps`: what stays when all else is made anew."""

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


# ---- processes


def session(leader: int) -> list[int]:
    """The processes of a session that run (zombies don't)."""
    found = []
    for entry in os.listdir("/proc"):
        with contextlib.suppress(OSError, ValueError, IndexError):
            fields = Path("/proc", entry, "stat").read_text().rsplit(")", 1)[1].split()
            if int(fields[3]) == leader and fields[0] not in "ZX":
                found.append(int(entry))
    return found


def outlived(leader: int) -> list[int]:
    """Processes of a session that are there after their time to end; they are killed."""
    end = time.monotonic() + PATIENCE
    while (left := session(leader)) and time.monotonic() < end:
        time.sleep(0.02)
    for process in left:
        with contextlib.suppress(OSError):
            os.kill(process, signal.SIGKILL)
    return left


def ended(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit code and standard error; a hang is an error."""
    with _killed_at_last(process):
        _, err = process.communicate(timeout=LIMIT)
        return process.returncode, err


@contextlib.contextmanager
def _killed_at_last(process: subprocess.Popen[str]) -> Iterator[None]:
    try:
        yield
    finally:
        if process.poll() is None:
            with contextlib.suppress(OSError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


# ---- what happened


@dataclass
class Tally:
    """Counts of one kind of fault, and a sentence on each thing that went wrong."""

    kills: int = 0
    finished: int = 0
    """runs that were over before the signal came"""
    differences: int = 0
    orphans: int = 0
    left_at_once: int = 0
    """temporary files after a kill, which the next run removes"""
    left: int = 0
    """temporary files in the end"""
    tracebacks: int = 0
    wrong: list[str] = field(default_factory=list)

    @property
    def clean(self) -> bool:
        return not (self.differences or self.orphans or self.left or self.tracebacks or self.wrong)

    def say(self, text: str) -> None:
        self.wrong.append(text)


@dataclass(frozen=True)
class Reference:
    """What an undisturbed run leaves, and its `seconds`."""

    whole: dict[str, bytes]
    seconds: float


def reference(command: Command, home: Path) -> Reference:
    fresh(command, home)
    begin = time.monotonic()
    code, err = ended(start(command, home))
    seconds = time.monotonic() - begin
    assert code == 0, err
    return Reference(contents(command, home), seconds)


def disturb(command: Command, home: Path, known: Reference, kind: signal.Signals, after: float, tally: Tally) -> None:
    """Run the command, send the signal after so many seconds (Ctrl-C to all its processes), and look at what is left."""
    process = start(command, home)
    with _killed_at_last(process):
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(after)
        tally.finished += process.poll() is not None
        tally.kills += process.poll() is None
        with contextlib.suppress(ProcessLookupError):
            if kind is signal.SIGINT:
                os.killpg(process.pid, kind)
            else:
                process.send_signal(kind)
        code, err = ended(process)
    _judge_end(f"{command.name} {kind.name} after {after:.3f} s", kind, code, err, tally)
    orphans = outlived(process.pid)
    tally.orphans += len(orphans)
    for name, data in contents_now(command, home).items():
        if name not in known.whole:
            tally.left_at_once += 1
        elif data not in (known.whole[name], OLD) and not (
            kind is signal.SIGINT and command.partial(name, data, known.whole[name])
        ):
            tally.differences += command is not TRAINING  # its files grow
            if command is not TRAINING:
                tally.say(f"{command.name} {kind.name} after {after:.3f} s: {name} is neither old nor new")


def contents_now(command: Command, home: Path) -> dict[str, bytes]:
    """`contents`, of a training only the names: its files grow."""
    if command is not TRAINING:
        return contents(command, home)
    files = (p for p in (home / "out").rglob("*") if p.is_file() and "events" not in p.parts)
    return {str(p.relative_to(home / "out")): b"" for p in files}


def _judge_end(what: str, kind: signal.Signals, code: int, err: str, tally: Tally) -> None:
    """A traceback of ours is one too many; before our first line the interpreter itself may still be starting."""
    if "Traceback" in err and "rcdn" in err and kind is signal.SIGINT:
        tally.tracebacks += 1
        tally.say(f"{what}: {err[-2000:]}")
    allowed = {
        signal.SIGINT: (0, 130, -signal.SIGINT, 1),
        signal.SIGTERM: (0, -signal.SIGTERM),
        signal.SIGKILL: (0, -signal.SIGKILL),
    }
    if code not in allowed[kind] or (code == 1 and "rcdn" in err):
        tally.say(f"{what}: exit code {code}: {err[-2000:]}")


def again(command: Command, home: Path, known: Reference, tally: Tally) -> None:
    """Say the command again, undisturbed: now all must be as if nothing had happened."""
    process = start(command, home)
    code, err = ended(process)
    tally.orphans += len(outlived(process.pid))
    if code != 0:
        tally.say(f"{command.name} again: exit code {code}: {err[-2000:]}")
        tally.differences += 1
        return
    compare(command, home, known, tally)


def compare(command: Command, home: Path, known: Reference, tally: Tally) -> None:
    """Count what differs from the undisturbed run."""
    found = contents(command, home)
    for name in sorted(found.keys() | known.whole.keys()):
        if name not in known.whole:
            tally.left += 1
            tally.say(f"{command.name}: {name} is left")
        elif found.get(name) != known.whole[name]:
            tally.differences += 1
            tally.say(f"{command.name}: {name} {'differs' if name in found else 'is missing'}")


# ---- other faults


def kill_a_worker(command: Command, home: Path, known: Reference, after: float, tally: Tally) -> None:
    """Kill one of the processes that the command started, as a system without memory does: nothing may be lost."""
    fresh(command, home, everything=True)
    process = start(command, home)
    with _killed_at_last(process):
        end = time.monotonic() + after
        while not (workers := _workers(process.pid)) or time.monotonic() < end:
            if process.poll() is not None:
                break
            time.sleep(0.005)
        for worker in workers[:1]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(worker, signal.SIGKILL)
                tally.kills += 1
        code, err = ended(process)
    if code != 0:
        tally.say(f"{command.name}, a worker killed after {after:.3f} s: exit code {code}: {err[-2000:]}")
    tally.orphans += len(outlived(process.pid))
    compare(command, home, known, tally)


def _workers(leader: int) -> list[int]:
    found = []
    for process in session(leader):
        with contextlib.suppress(OSError):
            if b"spawn_main" in Path("/proc", str(process), "cmdline").read_bytes():
                found.append(process)
    return found


def two_at_once(command: Command, home: Path, known: Reference, tally: Tally) -> None:
    """Two runs on the same outputs: each may win, and the file is whole."""
    fresh(command, home)
    processes = [start(command, home), start(command, home)]
    for process in processes:
        code, err = ended(process)
        alone = command is TRAINING and "another process trains there" in err
        if code != 0 and not alone:
            tally.say(f"{command.name}, two at once: exit code {code}: {err[-2000:]}")
        tally.orphans += len(outlived(process.pid))
    tally.kills += 1
    compare(command, home, known, tally)
