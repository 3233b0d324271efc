"""The weights with which a figure was measured, recorded with it, so that a file is recognised as outdated when its
network has changed."""

from __future__ import annotations

from collections.abc import Iterable

from rcdn.config import DetectorConfig
from rcdn.corners.response import load_model

PRESETS = ("auto", "paper")


def weights_of(names: Iterable[str]) -> dict[str, str]:
    """Preset → sha256 of the weights of its network; names that are not presets are left out."""
    return {name: load_model(DetectorConfig.preset(name).weights).facts["sha256"] for name in names if name in PRESETS}
