"""Pictures that take longer than photographs, by name. The same name gives the same bytes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from rcdn.types import Array
from rcdn_lab.worst_case import checkers, textures

SMALL, MIDDLE, LARGE = (1000, 1000), (2000, 2000), (4000, 3000)
"""(width, height) px: 1, 4 and 12 megapixels"""
SIZES = {"1 MP": SMALL, "4 MP": MIDDLE, "12 MP": LARGE}
_Make = Callable[..., Array]


def _boards() -> dict[str, Callable[[], Array]]:
    """One board of tiny squares."""
    made: dict[str, Callable[[], Array]] = {}
    for pitch in (4, 5, 6, 8, 10):
        for name, size in SIZES.items():
            made[f"board of {pitch} px squares, {name}"] = partial(
                checkers.board, size, pitch, 0.0 if pitch < 8 else 0.07
            )
    for pitch in (5, 7):
        made[f"board of {pitch} px squares, cut, 1 MP"] = partial(checkers.cut, SMALL, pitch, 0.07)
    made["board of 5 px squares, 866 × 1155 px"] = partial(checkers.board, (866, 1155), 5)
    made["board of 6.25 px squares, 4 MP, 100,000 corners"] = partial(checkers.board, MIDDLE, 6.25)
    made["screen of 59 × 33 squares, 12 MP"] = partial(checkers.screen, LARGE, 59, 33)
    made["screen of 160 × 120 squares, 12 MP"] = partial(checkers.screen, LARGE, 160, 120)
    return made


def _several() -> dict[str, Callable[[], Array]]:
    """Many boards, and boards that are broken, bent or not quite boards."""
    kinds: dict[str, tuple[_Make, tuple[object, ...]]] = {
        "boards of 3 × 3 squares of 8 px": (checkers.many, (3, 8, 8)),
        "boards of 4 × 4 squares of 8 px": (checkers.many, (4, 8, 6)),
        "boards of 5 × 5 squares of 6 px": (checkers.many, (5, 6, 6)),
        "boards of 6 × 6 squares of 12 px": (checkers.many, (6, 12, 10)),
        "turned boards of 5 × 5 squares of 8 px": (checkers.turned, (5, 8, 16, 1)),
        "boards that touch, 10 px": (checkers.touching, (10, 61)),
        "board with a tenth of its squares flipped, 8 px": (checkers.flipped, (8, 0.1, 2)),
        "board with a hundredth of its squares flipped, 8 px": (checkers.flipped, (8, 0.01, 3)),
        "board with holes, 8 px": (checkers.holed, (8, 30, 60)),
        "boards in boards": (checkers.nested, (200.0, 3)),
        "spiral": (checkers.warped, (8.0, checkers.spiral)),
        "rings": (checkers.warped, (8.0, checkers.rings)),
        "waving board, 8 px": (checkers.warped, (8.0, checkers.waves)),
        "codes of 4 px bits": (checkers.codes, (4, 6, 4)),
        "codes of 8 px bits": (checkers.codes, (8, 8, 5)),
        "triangles of 12 px": (checkers.triangles, (12.0,)),
        "triangles of 24 px": (checkers.triangles, (24.0,)),
    }
    sizes = {name: size for name, size in SIZES.items() if name != "12 MP"}
    return {
        f"{kind}, {name}": partial(make, size, *rest)
        for kind, (make, rest) in kinds.items()
        for name, size in sizes.items()
    }


def _textures() -> dict[str, Callable[[], Array]]:
    """Pictures without a board."""
    kinds: dict[str, tuple[_Make, tuple[object, ...]]] = {
        "white noise": (textures.white_noise, ()),
        "noise blurred by 1 px": (textures.smooth_noise, (1.0,)),
        "noise blurred by 2 px": (textures.smooth_noise, (2.0,)),
        "noise blurred by 5 px": (textures.smooth_noise, (5.0,)),
        "salt and pepper": (textures.salt_and_pepper, (0.05,)),
        "random squares of 5 px": (textures.checker_noise, (5,)),
        "random squares of 8 px": (textures.checker_noise, (8,)),
        "random squares of 16 px": (textures.checker_noise, (16,)),
        "saddles of 8 px": (textures.saddles, (8.0,)),
        "saddles of 12 px": (textures.saddles, (12.0,)),
        "saddles of 20 px": (textures.saddles, (20.0,)),
        "saddles of 40 px": (textures.saddles, (40.0,)),
        "half-tone dots of 6 px": (textures.halftone, (6.0,)),
        "half-tone dots of 12 px": (textures.halftone, (12.0,)),
        "moiré": (textures.moire, ()),
        "zone plate": (textures.zone_plate, ()),
        "grid of lines": (textures.lines, (12,)),
        "grid of wide lines": (textures.lines, (20, 8)),
        "circles": (textures.circles, (14,)),
        "bricks": (textures.bricks, (16, 8)),
        "stripes": (textures.stripes, (8,)),
        "text": (textures.text, (14,)),
        "JPEG blocks": (textures.blocks, (4,)),
        "16-bit noise": (textures.sixteen_bits, ()),
        "float noise": (textures.reals, (1e6,)),
    }
    made: dict[str, Callable[[], Array]] = {
        f"{k}, 1 MP": partial(make, SMALL, *rest) for k, (make, rest) in kinds.items()
    }
    return made | {
        f"{kind}, 12 MP": partial(kinds[kind][0], LARGE, *kinds[kind][1])
        for kind in (
            "white noise",
            "noise blurred by 2 px",
            "random squares of 8 px",
            "saddles of 12 px",
            "half-tone dots of 12 px",
        )
    }


def _shapes() -> dict[str, Callable[[], Array]]:
    """Unusual sizes and uniform pictures."""
    made: dict[str, Callable[[], Array]] = {
        "1 × 1 px": partial(textures.constant, (1, 1), 255),
        "2 × 2 px of noise": partial(textures.white_noise, (2, 2)),
        "board of 4 × 4 squares in 40 × 40 px": partial(checkers.many, (40, 40), 4, 8, 8),
        "noise, 300 × 300 px": partial(textures.white_noise, (300, 300)),
        "board of 6 px squares, 320 × 250 px": partial(checkers.board, (320, 250), 6),
        "noise, 1,000,000 × 3 px": partial(textures.white_noise, (1_000_000, 3)),
        "noise, 3 × 1,000,000 px": partial(textures.white_noise, (3, 1_000_000)),
        "board, 100,000 × 60 px": partial(checkers.board, (100_000, 60), 8),
        "board, 60 × 100,000 px": partial(checkers.board, (60, 100_000), 8),
    }
    return made | {f"all {level}, 12 MP": partial(textures.constant, LARGE, level) for level in (0, 128, 255)}


def pictures() -> dict[str, Callable[[], Array]]:
    """All of them: name → the function that makes the picture."""
    return _boards() | _several() | _textures() | _shapes()
