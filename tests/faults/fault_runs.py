"""Commands that are disturbed: real processes, killed at some moment, and what must hold of all that they leave."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from fault_commands import OLD, TRAINING, Command, contents, contents_at_once, fresh, start

PATIENCE = 20.0
"""seconds that processes have to end in after the first one; workers of a training take 5 to see it"""
LIMIT = 300.0
"""seconds after which a run hangs"""

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

    def report(self, text: str) -> None:
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
    """Run the command, send the signal after so many seconds (Ctrl-C to all its processes),
    and look at what is left."""
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
    for name, data in contents_at_once(command, home).items():
        if name not in known.whole:
            tally.left_at_once += 1
        elif data not in (known.whole[name], OLD) and not (
            kind is signal.SIGINT and command.partial(name, data, known.whole[name])
        ):
            tally.differences += command is not TRAINING  # its files grow
            if command is not TRAINING:
                tally.report(f"{command.name} {kind.name} after {after:.3f} s: {name} is neither old nor new")


def _judge_end(what: str, kind: signal.Signals, code: int, err: str, tally: Tally) -> None:
    """A traceback of ours is one too many; before our first line the interpreter itself may still be starting."""
    if "Traceback" in err and "rcdn" in err and kind is signal.SIGINT:
        tally.tracebacks += 1
        tally.report(f"{what}: {err[-2000:]}")
    allowed = {
        signal.SIGINT: (0, 130, -signal.SIGINT, 1),
        signal.SIGTERM: (0, -signal.SIGTERM),
        signal.SIGKILL: (0, -signal.SIGKILL),
    }
    if code not in allowed[kind] or (code == 1 and "rcdn" in err):
        tally.report(f"{what}: exit code {code}: {err[-2000:]}")


def again(command: Command, home: Path, known: Reference, tally: Tally) -> None:
    """Run the command again, undisturbed: now all must be as if nothing had happened."""
    process = start(command, home)
    code, err = ended(process)
    tally.orphans += len(outlived(process.pid))
    if code != 0:
        tally.report(f"{command.name} again: exit code {code}: {err[-2000:]}")
        tally.differences += 1
        return
    compare(command, home, known, tally)


def compare(command: Command, home: Path, known: Reference, tally: Tally) -> None:
    """Count what differs from the undisturbed run."""
    found = contents(command, home)
    for name in sorted(found.keys() | known.whole.keys()):
        if name not in known.whole:
            tally.left += 1
            tally.report(f"{command.name}: {name} is left")
        elif found.get(name) != known.whole[name]:
            tally.differences += 1
            tally.report(f"{command.name}: {name} {'differs' if name in found else 'is missing'}")


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
        tally.report(f"{command.name}, a worker killed after {after:.3f} s: exit code {code}: {err[-2000:]}")
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
            tally.report(f"{command.name}, two at once: exit code {code}: {err[-2000:]}")
        tally.orphans += len(outlived(process.pid))
    tally.kills += 1
    compare(command, home, known, tally)
