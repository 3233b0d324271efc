"""Lattices of tags of which a part is labelled a tag too far, as links over a whole tag can have it: exact corners."""

import numpy as np
import pytest

from rcdn.boards.alternating import alternating
from rcdn.boards.graph import Field

GAP = 0.3


def tags(columns=6, rows=6):
    """A field with the corners of an AprilGrid in perspective, and {label: corner}."""
    labels = [(u, v) for v in range(2 * rows) for u in range(2 * columns)]
    printed = np.array([[k // 2 * (1 + GAP) + k % 2 for k in label] for label in labels])
    flat = np.c_[40 * printed + 50, np.ones(len(labels))] @ np.array([[1, 0.1, 1e-4], [-0.1, 0.9, 3e-4], [0, 0, 1]])
    xy, one = flat[:, :2] / flat[:, 2:], np.ones(len(labels))
    sure = one.astype(bool)
    field = Field(np.zeros((480, 640), np.float32), xy, np.c_[one, one], one, one, one, one, sure, sure)
    return field, {label: k for k, label in enumerate(labels)}


@pytest.mark.parametrize("shift", [(0, 2), (0, -2), (2, 0)])
def test_a_part_that_is_shifted_by_a_tag_is_taken_from_the_rest(shift):
    field, true = tags()
    apart = {(u, v): corner for (u, v), corner in true.items() if u >= 8 and v < 6}
    wrong = {(u + shift[0], v + shift[1]): corner for (u, v), corner in apart.items()}
    grid = {label: corner for label, corner in true.items() if label not in apart and label not in wrong} | wrong
    (found,) = alternating(field, [grid], np.ones(len(field.xy), bool))
    assert found == true


def test_a_lattice_without_contradiction_is_left_alone():
    field, true = tags()
    assert alternating(field, [true], np.ones(len(field.xy), bool)) == [true]
