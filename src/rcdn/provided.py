"""Where the methods of a camera find the work that floors above it do (docs/decisions/0028-methods-of-values.md).

`rcdn.types.camera` says what it needs, as a protocol; the package, which stands above all floors, says here who does it. Nothing is imported
before it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_providers: list[Callable[[], Any]] = []


def provide_camera_work(provider: Callable[[], Any]) -> None:
    """Let `provider()` be what does the work of `rcdn.types.camera.CameraWork`. Called once, by `rcdn/__init__.py`."""
    _providers[:] = [provider]


def camera_work() -> Any:
    """What does the work of `rcdn.types.camera.CameraWork`."""
    return _providers[0]()
