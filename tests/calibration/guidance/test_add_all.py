"""Pictures of an earlier session are taken up at once."""

import numpy as np

from rcdn.calibration.guidance import Guide
from rcdn_lab.camera_scenes import CAMERAS, SPACING, WIDE, random_boards


def test_all_at_once_is_as_one_after_the_other():
    boards, _ = random_boards(CAMERAS["pinhole"], 3, views=4, whole=True)
    named = {f"{k}": board for k, board in enumerate(boards)}
    slow, quick = Guide(WIDE, SPACING, model="pinhole"), Guide(WIDE, SPACING, model="pinhole")
    for name, board in named.items():
        slow.add(board, name)
    quick.add_all(named)
    assert quick.progress.views == slow.progress.views == tuple(named)
    assert np.isclose(quick.progress.worst, slow.progress.worst, rtol=1e-6)
    assert quick.add_all({}).views == tuple(named)
