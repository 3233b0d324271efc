"""Simulated rigs: cameras at known places, boards that some of them see at each moment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.geometry import rotation
from rcdn.types import Array, Board, Camera
from rcdn_lab.camera_scenes import CAMERAS, SIZE, SPACING, board, see

NOISE = 0.2
"""px"""


@dataclass(frozen=True, eq=False)
class Scene:
    """`cameras` and T_cam_world (4, 4) by name; `near`: for each place of boards a camera before which they are, and
    one beside it or −1. Boards' middles are up to `tangent` off the axis (x, y) and `reach` m ahead of the camera
    before which they are."""

    cameras: dict[str, Camera]
    places: dict[str, Array]
    tangent: tuple[float, float] = (0.55, 0.4)
    reach: tuple[float, float] = (0.45, 1.1)

    def views(
        self, rng: np.random.Generator, between: list[tuple[int, int]], noise: float = NOISE
    ) -> tuple[dict[str, list[Board]], dict[str, list[str]]]:
        """Boards and their moments by camera: one board a moment, before the two cameras of `between` (one
        twice: before it alone)."""
        boards: dict[str, list[Board]] = {name: [] for name in self.cameras}
        moments: dict[str, list[str]] = {name: [] for name in self.cameras}
        whole, names = SIZE[0] * SIZE[1], list(self.cameras)
        for m, (a, b) in enumerate(between):
            for _ in range(2000):
                T = self._board(rng, names[a], names[b])
                seen = {n: see(self.cameras[n], self.places[n] @ T) for n in names if self._faces(n, T)}
                if all(n in seen and len(seen[n][0]) == whole for n in {names[a], names[b]}):
                    break
            else:
                raise RuntimeError(f"cameras {names[a]} and {names[b]} share no view")
            for n, (ij, xy) in seen.items():
                if len(ij) == whole:
                    noisy = xy + rng.normal(0, noise, xy.shape)
                    boards[n].append(board(ij, noisy, self.cameras[n].image_size, np.full(len(xy), noise)))
                    moments[n].append(str(m))
        return boards, moments

    def _faces(self, name: str, T: Array) -> bool:
        """Whether the camera sees the board's front, not too flatly."""
        C = self.places[name] @ T
        middle = C[:3, :3] @ np.array([(SIZE[0] - 1) / 2 * SPACING, (SIZE[1] - 1) / 2 * SPACING, 0]) + C[:3, 3]
        return bool(C[:3, 2] @ middle > 0.3 * np.linalg.norm(middle) and middle[2] > 0)

    def _board(self, rng: np.random.Generator, a: str, b: str) -> Array:
        """T_world_board of a board somewhere in the picture of `a`, turned to the middle of both cameras."""
        cam = np.linalg.inv(self.places[a])
        across, down = self.tangent
        ray = np.append(rng.uniform([-across, -down], [across, down]), 1.0) * rng.uniform(*self.reach)
        at = cam[:3, :3] @ ray + cam[:3, 3]
        eyes = (cam[:3, 3] + np.linalg.inv(self.places[b])[:3, 3]) / 2
        T = np.linalg.inv(look_at(eyes, at))
        T[:3, :3] = T[:3, :3] @ rotation(rng.normal(0, 0.3, 3))
        T[:3, 3] = at - T[:3, :3] @ np.array([(SIZE[0] - 1) / 2 * SPACING, (SIZE[1] - 1) / 2 * SPACING, 0])
        return T


def look_at(eye: Array, at: Array) -> Array:
    """T_cam_world (4, 4) of a camera at `eye` that looks `at` a point, its y axis downwards (world's z up)."""
    z = (at - eye) / np.linalg.norm(at - eye)
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, -R @ eye
    return T


def ring(count: int, inwards: float, kinds: tuple[str, ...] = ("brown",)) -> Scene:
    """Cameras on a circle of 0.15 m that look outwards, or of `inwards` m (> 0) that look to its middle."""
    cameras, places = {}, {}
    for k in range(count):
        turn = 2 * np.pi * k / count
        out = np.array([np.cos(turn), np.sin(turn), 0.1])
        eye = out * (inwards or 0.15)
        cameras[f"c{k}"] = CAMERAS[kinds[k % len(kinds)]]
        places[f"c{k}"] = look_at(eye, np.zeros(3) if inwards else out * 5)
    return Scene(cameras, places)


def outwards(overlap: float = 0.1) -> Scene:
    """Four cameras that look outwards from a ring of 0.15 m, whose neighbours share an `overlap` of
    their pictures' angle."""
    focal = 320 / np.tan(np.radians(45) / (1 - overlap))
    camera = Camera(
        np.array([[focal, 0, 322], [0, focal, 238], [0, 0, 1.0]]),
        np.array([-0.02, 0.002, 0.001, -0.0005, 0.0]),
        (640, 480),
    )
    places = ring(4, 0.0).places
    return Scene(dict.fromkeys(places, camera), places, (1.1, 0.6), (0.5, 3.2))


def row(gaps: list[float], kinds: tuple[str, ...] = ("brown",)) -> Scene:
    """Cameras side by side, each `gaps` m beside the one before, all looking the same way."""
    cameras, places, x = {}, {}, 0.0
    for k, gap in enumerate([0.0, *gaps]):
        x += gap
        eye = np.array([x, 0, 0.02 * (k % 3)])
        cameras[f"c{k}"] = CAMERAS[kinds[k % len(kinds)]]
        places[f"c{k}"] = look_at(eye, eye + np.array([0.05 * (-1) ** k, 1, 0]))
    return Scene(cameras, places)


def room(count: int, side: float = 2.2, kinds: tuple[str, ...] = ("brown",)) -> Scene:
    """Cameras along the walls of a square room of `side` m, at the same distance from each other,
    that look to the wall opposite."""
    cameras, places = {}, {}
    for k in range(count):
        turn = 2 * np.pi * k / count
        eye = side / 2 * np.array([np.cos(turn), np.sin(turn), 0.15 * (-1) ** k])
        cameras[f"c{k:02d}"] = CAMERAS[kinds[k % len(kinds)]]
        places[f"c{k:02d}"] = look_at(eye, np.array([0.2 * np.cos(turn + 2), 0.2 * np.sin(turn + 2), 0]))
    return Scene(cameras, places)


def clusters(each: int) -> Scene:
    """Two rows of cameras `each`, beside each other: one camera of the first joins them, its last one,
    which sees what the second row sees."""
    parts = [row([0.25] * (each - 1)), row([0.25] * (each - 1))]
    cameras, places = {}, {}
    for p, part in enumerate(parts):
        for name, T in part.places.items():
            moved = T.copy()
            moved[:3, 3] -= T[:3, :3] @ np.array([(0.25 * each) * p, 0, 0])
            cameras[f"{'ab'[p]}{name}"], places[f"{'ab'[p]}{name}"] = part.cameras[name], moved
    return Scene(cameras, places)


def joined(each: int, many: int) -> list[tuple[int, int]]:
    """Places of boards in two `clusters`: `many` before each camera and between neighbours of one row; the rows only
    share some before the last camera of the first and the first of the second."""
    own = [(a + p * each, b + p * each) for p in range(2) for a, b in chain(each, many)]
    return own + [(each - 1, each)] * many


def chain(count: int, each: int, closed: bool = False) -> list[tuple[int, int]]:
    """Places of boards: `each` times before every camera alone and between every two neighbours."""
    alone = [(k, k) for k in range(count) for _ in range(each)]
    return alone + [(k, (k + 1) % count) for k in range(count if closed else count - 1) for _ in range(each)]
