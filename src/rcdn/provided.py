"""Registry through which the methods of `Camera` reach their implementation in higher packages
(docs/decisions/0028-methods-of-values.md).

`rcdn.types.camera` declares the interface as a protocol; the top-level package, which may import all others, registers
the implementation here. The implementation is imported at its first use.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_providers: list[Callable[[], Any]] = []


def provide_camera_work(provider: Callable[[], Any]) -> None:
    """Register `provider()` as the source of the implementation of `rcdn.types.camera.CameraWork`. Called once, by
    `rcdn/__init__.py`."""
    _providers[:] = [provider]


def camera_work() -> Any:
    """The registered implementation of `rcdn.types.camera.CameraWork`."""
    return _providers[0]()
