"""Which weights a figure was measured with, to be written beside it: a file whose network has changed since is told from one that hasn't."""

from __future__ import annotations

from collections.abc import Iterable

from rcdn.config import DetectorConfig
from rcdn.corners.response import load_model

PRESETS = ("auto", "paper")


def weights_of(names: Iterable[str]) -> dict[str, str]:
    """Preset → sha256 of the weights of its network; names that aren't presets are left out."""
    return {name: load_model(DetectorConfig.preset(name).weights).facts["sha256"] for name in names if name in PRESETS}
