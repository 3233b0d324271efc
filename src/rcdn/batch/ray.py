"""Workers that are actors of a Ray cluster: same order, retries and messages as with processes, whatever the machines.

Reasons for actors rather than Ray Data: docs/decisions/0015-ray-actors.md.
"""

from __future__ import annotations

import contextlib
import logging
import os
import socket
import threading
from collections import deque
from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import replace
from importlib.util import find_spec
from typing import Any

from rcdn import __version__
from rcdn.batch.pool import share_out
from rcdn.batch.processes import no_interrupts, one_opencv_thread
from rcdn.batch.work import Done, Picture, Work
from rcdn.batch.workers import HAND, LOST, Item
from rcdn.errors import DependencyError, RcdnError
from rcdn.limits import max_megapixels, set_max_megapixels

LOCAL = "local"
"""the address of a cluster that is started for one run"""
REACH = 10.0
"""timeout of the connection to a cluster, in seconds"""
_QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",  # a command-line tool must not send usage statistics
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
}
_LOOPBACK = {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0"}
"""for a cluster on this machine only: its services listen on the loopback interface, as they do on Windows and macOS,
not on the whole network"""


def check() -> None:
    """Raise DependencyError if Ray isn't installed."""
    if find_spec("ray") is None:
        raise DependencyError("--engine ray needs Ray: pip install 'rcdn[ray]'")


def compute(
    pictures: Iterable[Picture], work: Work, jobs: int, address: str | None = None
) -> Generator[Done, None, None]:
    """`rcdn.batch.pool.compute` with `jobs` actors (0: one for each CPU) of the cluster at `address`; None: a local
    cluster is started for this call.

    All machines need rcdn of this version, and the current folder on a shared disk. Raises DependencyError without Ray,
    RcdnError if there is no such cluster or no actor can be started.
    """
    check()
    with _cluster(address or LOCAL, jobs) as ray:
        have = ray.cluster_resources()
        jobs = jobs or max(1, int(have.get("CPU", 1)))
        yield from share_out(pictures, work, Actors(ray, work, jobs, have.get("GPU", 0.0)), jobs)


@contextlib.contextmanager
def _cluster(address: str, jobs: int) -> Iterator[Any]:
    """The module `ray`, connected to the cluster; at the end it is disconnected, and a cluster started here is
    stopped."""
    for name, value in (_QUIET | (_LOOPBACK if address == LOCAL else {})).items():
        os.environ.setdefault(name, value)  # read when Ray is imported, and by the processes that it starts
    import ray

    ours: dict[str, Any] = {"num_cpus": jobs or None, "include_dashboard": False} if address == LOCAL else {}
    # Ray prints the death of each worker to standard output, whatever its settings, sometimes only when it shuts down;
    # detections may be written there, too.
    with open(os.devnull, "w") as nothing, contextlib.redirect_stdout(nothing):
        try:
            _reach(address)
            with no_interrupts():
                ray.init(address=address, log_to_driver=False, logging_level=logging.CRITICAL, **ours)
        except (ConnectionError, OSError, RuntimeError, ValueError) as error:
            reason = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
            raise RcdnError(
                f"--engine ray: no cluster at {address}: {reason}; check --address and RAY_ADDRESS"
            ) from error
        try:
            yield ray
        finally:
            with no_interrupts():
                ray.shutdown()


def _reach(address: str) -> None:
    """Raise OSError if HOST:PORT accepts no connection: Ray itself would retry for minutes."""
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if colon and port.isdecimal():
        socket.create_connection((host.strip("[]"), int(port)), timeout=REACH).close()


class Actors:
    """Starts actors that run `work`; see `rcdn.batch.workers.Crew`. `jobs` actors share `cards` GPUs."""

    instead = "--engine local"

    def __init__(self, ray: Any, work: Work, jobs: int, cards: float) -> None:
        self._ray = ray
        self._work = ray.put(work)
        share = int(min(1.0, cards / jobs) * 1e4) / 1e4  # Ray's resolution of resources is 1e-4
        self._class = ray.remote(_Actor).options(
            num_cpus=1, num_gpus=share, max_concurrency=HAND, max_restarts=0, max_task_retries=0
        )

    def start(self) -> Actor:
        return Actor(self._ray, self._class.remote(self._work))

    def hear(self, workers: Sequence[Actor]) -> list[tuple[Actor, Any]]:
        first = {w.answers[0]: w for w in workers if w.answers}
        ready, more = self._ray.wait(list(first), num_returns=1)
        if more:
            ready += self._ray.wait(more, num_returns=len(more), timeout=0)[0]
        return [(first[answer], first[answer].message()) for answer in ready]


class Actor:
    """The caller's handle of an actor; see `rcdn.batch.workers.Worker`. `answers`: the pending results, in request
    order."""

    def __init__(self, ray: Any, handle: Any) -> None:
        self._ray = ray
        self._handle = handle
        self._cause = ""
        self._turn = 0
        self.ready = False
        self.items: deque[Item] = deque()
        self.answers: deque[Any] = deque([handle.prepare.remote(os.getcwd(), __version__, max_megapixels())])

    def send(self, picture: Picture) -> None:
        self.answers.append(self._handle.compute.remote(self._turn, picture))
        self._turn += 1

    def message(self) -> Any:
        """The first pending result, which must be available; LOST if the actor died."""
        try:
            return self._ray.get(self.answers.popleft())
        except self._ray.exceptions.RayError as error:
            lines = [line.strip() for line in str(error).splitlines() if line.strip()]
            self._cause = lines[-1].partition(". ")[0] if lines else type(error).__name__
            return LOST

    def dismiss(self) -> None:
        self._ray.kill(self._handle)

    def end(self, deadline: float) -> str:
        """Kill the actor at once: one that can't be reached may still run, and its pictures must not be computed
        twice."""
        self._ray.kill(self._handle)
        return self._cause


# ---- in the cluster


class _Actor:
    """Processes the calls of `compute` in the order of `turn`, whichever thread is first; each thread reads its picture
    before its turn."""

    def __init__(self, work: Work) -> None:
        self._work = work
        self._turn = 0
        self._next = threading.Condition()

    def prepare(self, folder: str, version: str, megapixels: float) -> RcdnError | None:
        """Make the detector in the working folder `folder`, to which the pictures' paths are relative; returns an error
        or None. `megapixels`: the limit on a picture's size."""
        try:
            if version != __version__:
                raise RcdnError(f"--engine ray: a machine of the cluster has rcdn {__version__}, this one {version}")
            _enter(folder)
            set_max_megapixels(megapixels)
            one_opencv_thread()
            self._work.prepare()
        except RcdnError as error:
            return error
        except Exception as error:
            return RcdnError(f"{type(error).__name__}: {error}")
        return None

    def compute(self, turn: int, picture: Picture) -> Done:
        picture = self._work.loaded(_own(picture))
        with self._next:
            self._next.wait_for(lambda: self._turn == turn)
        try:
            return self._work(picture)
        finally:
            with self._next:
                self._turn += 1
                self._next.notify_all()


def _enter(folder: str) -> None:
    try:
        os.chdir(folder)
    except OSError as error:
        raise RcdnError(
            f"--engine ray: a machine of the cluster has no folder {folder} ({error.strerror}); "
            "pictures must lie on a disk that all share"
        ) from error


def _own(picture: Picture) -> Picture:
    """`picture` with writable pixels: Ray shares arrays between processes read-only, and a detector always gets its own
    copy."""
    if picture.grey is None or picture.grey.flags.writeable:
        return picture
    return replace(picture, grey=picture.grey.copy())
