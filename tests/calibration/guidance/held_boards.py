"""Boards as one and as two cameras see them, and guides that have taken them."""

import numpy as np

from rcdn.calibration.guidance import Guide, PairGuide
from rcdn_lab.camera_scenes import CAMERAS, SIZE, SPACING, WIDE, board, random_boards, random_pose, see

PINHOLE = CAMERAS["pinhole"]
T_RIGHT_LEFT = np.eye(4)
T_RIGHT_LEFT[0, 3] = -0.12


def whole(count):
    """Whole boards that one camera sees."""
    return random_boards(PINHOLE, 3, views=count, whole=True)[0]


def pairs(count):
    """Boards that both cameras see whole."""
    rng, found = np.random.default_rng(5), []
    while len(found) < count:
        T = random_pose(rng, 0.2, 0.7, (0.5, 0.8))
        seen = [see(PINHOLE, T), see(PINHOLE, T_RIGHT_LEFT @ T)]
        if all(len(ij) == SIZE[0] * SIZE[1] for ij, _ in seen):
            found.append(tuple(board(ij, xy + rng.normal(0, 0.1, xy.shape), WIDE) for ij, xy in seen))
    return found


def one(count=3):
    """A guide that has taken boards of one camera."""
    guide = Guide(WIDE, SPACING, model="pinhole")
    guide.add_all({str(k): b for k, b in enumerate(whole(4)[:count])})
    return guide


def two(count=3):
    """A guide that has taken boards of two cameras."""
    guide = PairGuide((WIDE, WIDE), SPACING, model="pinhole")
    guide.add_all({str(k): pair for k, pair in enumerate(pairs(4)[:count])})
    return guide
