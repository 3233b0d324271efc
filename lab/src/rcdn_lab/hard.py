"""F1 score of shipped weights on the fixed hard validation crops."""

from __future__ import annotations

from typing import Any

from rcdn.validation import score_crop, summary, validation_set
from rcdn_lab.table_weights import load_network


def table(models: tuple[str, ...] = ("auto", "paper")) -> list[dict[str, Any]]:
    """One row for each model: F1 at 2 px at its best threshold, precision, recall, average precision, mean distance of
    peaks from the truth, px."""
    out = []
    for name in models:
        model = load_network(name)
        scores = [score_crop(model(image, 1), labels) for image, labels in validation_set()]
        out.append({"model": name, "architecture": model.facts["architecture"], **summary(scores)})
    return out
