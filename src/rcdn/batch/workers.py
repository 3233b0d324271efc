"""What the pool of workers and its crews share: pictures in progress, workers, and their messages."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from rcdn.batch.work import Picture

HAND = 2
"""Pictures assigned to a worker at once: it processes the first, and reads the next one meanwhile."""
LOST = object()
"""The message received in place of a result when a worker has died."""


@dataclass(eq=False)
class Item:
    """A picture in progress: its `number` in the order; `deaths`: how many workers died while processing it; `alone`:
    no other picture may be processed at the same time."""

    number: int
    picture: Picture
    deaths: int = 0
    alone: bool = False


class Worker(Protocol):
    """A worker process or actor: `ready` once its detector is made; `items`: the pictures assigned to it, in processing
    order."""

    ready: bool
    items: deque[Item]

    def send(self, picture: Picture) -> None:
        """Assign a picture to this worker. Raises OSError if the worker is dead."""

    def dismiss(self) -> None:
        """Request that the worker ends, even while it is busy."""

    def end(self, deadline: float) -> str:
        """Wait for the worker to end, kill it after `deadline` (time.monotonic), and return the cause of its end."""


class Crew(Protocol):
    """Starts workers and receives their messages. `instead`: the option to suggest if no worker can be started."""

    instead: str

    def start(self) -> Worker:
        """Start a new worker, without waiting until it is ready."""

    def hear(self, workers: Sequence[Any]) -> list[tuple[Any, Any]]:
        """Wait for messages, and return (worker, message): None (it is ready), a Done of its first picture, an error or
        LOST."""
