"""Targets that carry codes: read on the boards that were found, without being told which."""

from __future__ import annotations

from rcdn.targets.read import identified

__all__ = ["identified"]
