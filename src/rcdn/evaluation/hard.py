"""F1 of shipped weights on the fixed hard validation crops."""

from __future__ import annotations

from typing import Any

import numpy as np

from rcdn.corners.response import load_model
from rcdn.metrics import best_f1
from rcdn.training.validate import score_crop, validation_set


def table(models: tuple[str, ...] = ("auto", "paper")) -> list[dict[str, Any]]:
    """One row a model: F1 at 2 px at its best threshold, precision, recall, average precision, mean distance of peaks to truth, px."""
    out = []
    for name in models:
        model = load_model(name)
        results = [score_crop(model(image, 1), labels) for image, labels in validation_set()]
        scores, hits, gaps = (np.concatenate([r[k] for r in results]) for k in range(3))
        row = best_f1(scores, hits, sum(r[3] for r in results))
        out.append(
            {
                "model": name,
                "architecture": model.facts["architecture"],
                **row,
                "pixel error": round(float(gaps.mean()), 3),
            }
        )
    return out
