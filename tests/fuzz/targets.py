"""All targets by name."""

from __future__ import annotations

from tests.fuzz import images, kernels, networks, texts, values
from tests.fuzz.target import Target

TARGETS: dict[str, Target] = {t.name: t for group in (texts, images, networks, values, kernels) for t in group.TARGETS}
