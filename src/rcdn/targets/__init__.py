"""Coded targets: recognised and decoded on recovered boards, without the user having to specify them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rcdn.targets.read import check_target, identified

__all__ = ["check_target", "identified"]


def __getattr__(name: str) -> Any:
    """The functions are loaded at their first use, since few boards carry codes."""
    if name not in __all__:
        raise AttributeError(f"module 'rcdn.targets' has no attribute {name!r}")
    from rcdn.targets import read

    return getattr(read, name)
