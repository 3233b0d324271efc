"""Conversion to and from mrcal's splined stereographic lens model `LENSMODEL_SPLINED_STEREOGRAPHIC`
(mrcal.secretsauce.net/splined-models.html)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rcdn.errors import RcdnError
from rcdn.geometry.correction import basis_at, bspline, point_of, stereographic, surface
from rcdn.geometry.lens import project, unproject
from rcdn.geometry.models import distorted
from rcdn.geometry.spline_grid import WIDEST, bending, frame_pixels
from rcdn.types import Array, Camera, LensCorrection
from rcdn.types.correction import DEGREE

CLOSE = 0.005
"""px: largest accepted difference of a spline from the camera over its frame"""
COLUMNS = (10, 14, 20, 28, 40, 56)
"""numbers of columns of control points that are tried"""
ALONG = 61
"""grid points along each side of the frame at which a spline is compared with the camera"""
BEYOND = 0.08
"""margin around the frame, as a share of its sides, where the spline is also fitted if the lens has rays there"""
SMOOTH = 1e-10
"""weight of the bending energy, which determines the spline where there are no rays, relative to that of the rays"""
REFINED = (1, 2, 3, 4)
"""refinement factors of mrcal's grid that are tried in turn, until the difference is small enough"""
STEREOGRAPHIC = (1 / 12, 1 / 120, 17 / 20160, 31 / 362880)
"""Kannala–Brandt coefficients of 2·tan(θ/2), from its series at 0: all positive, so that the map is monotonic"""


@dataclass(frozen=True, eq=False)
class Splined:
    """The model q = f·(u + S(u)) + c with `core` (4,) = fx, fy, cx, cy, px, and the cubic spline S with control points
    `control` (Ny, Nx, 2), as in `LensCorrection.control`; its cells are square, and its domain is `fov` degrees wide.
    `image_size` (width, height) px."""

    core: Array
    control: Array
    fov: int
    image_size: tuple[int, int]

    def __post_init__(self) -> None:
        if not 0 < self.fov < 360:
            raise RcdnError(f"Splined.fov must be between 0 and 360 degrees, not {self.fov}")

    @property
    def spline(self) -> LensCorrection:
        """The spline S."""
        rows, columns, _ = self.control.shape
        half = _half_width(self.fov)
        return LensCorrection(self.control, np.array([half, half * (rows - DEGREE) / (columns - DEGREE)]))

    def project(self, points: Array) -> Array:
        """Camera points (..., 3) to pixels (..., 2); outside of the spline's domain S is extended as in
        `LensCorrection`, not as in mrcal."""
        u = stereographic(points)
        return np.asarray((u + surface(self.spline, u)) * self.core[:2] + self.core[2:])


def _half_width(fov: float) -> float:
    return float(2 * np.tan(np.radians(fov) / 4))


def splined_of(camera: Camera) -> tuple[Splined, float, float]:
    """The camera as a splined stereographic one, with the RMS and the largest difference over the frame, px.

    Least-squares fit to the rays of the frame and of a margin around it, on the coarsest grid of COLUMNS whose
    difference is at most CLOSE, else on the finest. Rays over WIDEST degrees from the optical axis, where the
    stereographic plane grows without bound, are ignored. Raises RcdnError if the camera has no rays.
    """
    pixels, rays = _rays(camera, ALONG, 0.0)
    u = stereographic(rays)
    half = np.abs(u).max(axis=0) * (1 + 1e-6)
    fov = int(np.ceil(np.degrees(4 * np.arctan(half[0] / 2))))
    for columns in COLUMNS:
        found = _fitted(camera, columns, fov, half[1])
        gap = np.linalg.norm(found.project(rays) - pixels, axis=1)
        if gap.max() <= CLOSE:
            break
    return found, float(np.sqrt((gap**2).mean())), float(gap.max())


def _rays(camera: Camera, along: int, beyond: float) -> tuple[Array, Array]:
    """Pixels (N, 2) with rays up to WIDEST from the optical axis, and these rays (N, 3), of a grid over the frame and a
    margin of `beyond` times its sides."""
    middle = (np.array(camera.image_size) - 1) / 2
    pixels = middle + (frame_pixels(camera.image_size, along) - middle) * (1 + 2 * beyond)
    rays = unproject(camera, pixels)
    seen = np.degrees(np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])) <= WIDEST  # false for NaN
    if not seen.any():
        raise RcdnError("splined_of: no pixel of the camera has a ray; calibrate it first")
    return pixels[seen], rays[seen]


def _fitted(camera: Camera, columns: int, fov: int, half_height: float) -> Splined:
    """Least-squares spline with `columns` columns of control points."""
    from scipy.linalg import cho_factor, cho_solve
    from scipy.sparse import csr_array

    half = _half_width(fov)
    side = 2 * half / (columns - DEGREE)
    rows = max(int(np.ceil(2 * half_height / side)), 1) + DEGREE
    grid = LensCorrection(np.zeros((rows, columns, 2)), np.array([half, side * (rows - DEGREE) / 2]))
    pixels, rays = _rays(camera, max(4 * max(columns, rows), ALONG), BEYOND)
    u, core = stereographic(rays), camera.parameters[:4]
    inside = (np.abs(u) <= grid.extent).all(axis=1)
    target = ((pixels - core[2:]) / core[:2] - u)[inside]
    u = u[inside]
    at, weights = basis_at(grid, u)
    A = csr_array((weights.ravel(), at.ravel(), 16 * np.arange(len(u) + 1)), shape=(len(u), rows * columns))
    bend = bending(grid)
    normal = (A.T @ A).toarray()
    normal += bend * (SMOOTH * np.trace(normal) / np.trace(bend))
    control = cho_solve(cho_factor(normal), A.T @ target)
    return Splined(core, control.reshape(rows, columns, 2), fov, camera.image_size)


def camera_of(splined: Splined) -> Camera:
    """The splined camera as a fisheye close to 2·tan(θ/2) with a correction over the same domain, on a grid as fine as
    mrcal's or a few times finer. The remaining difference is of the order of a thousandth of a pixel; it is larger only
    outside of the domain.
    """
    fx, fy, cx, cy = splined.core
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    base = Camera(K, np.array(STEREOGRAPHIC), splined.image_size, "fisheye")
    spline = splined.spline
    for finer in REFINED:
        camera = replace(base, correction=_refitted(base, spline, finer))
        u = np.stack(np.meshgrid(*(np.linspace(-e, e, 2 * ALONG) for e in spline.extent)), axis=-1)
        points = point_of(u)
        if np.abs(project(camera, points) - splined.project(points)).max() <= CLOSE / 5:
            break
    return camera


def _refitted(base: Camera, spline: LensCorrection, finer: int) -> LensCorrection:
    """The sum of the spline and of the difference between the stereographic map and the map of `base`, as a spline over
    the same domain with cells smaller by the factor `finer`."""
    cells = finer * spline.cells
    nodes, designs = zip(*(_design(int(n), float(e)) for n, e in zip(cells, spline.extent, strict=True)), strict=True)
    u = np.stack(np.meshgrid(*nodes), axis=-1)
    wanted = surface(spline, u) + u - distorted(base, point_of(u))
    across = np.linalg.lstsq(designs[0], wanted.transpose(1, 0, 2).reshape(len(nodes[0]), -1), rcond=None)[0]
    across = across.reshape(-1, len(nodes[1]), 2).transpose(1, 0, 2)
    control = np.linalg.lstsq(designs[1], across.reshape(len(nodes[1]), -1), rcond=None)[0]
    return LensCorrection(control.reshape(-1, across.shape[1], 2), spline.extent)


def _design(cells: int, extent: float) -> tuple[Array, Array]:
    """Four nodes in each of `cells` cells on a line (4·cells,), and the cubic B-splines there (4·cells, cells + 3)."""
    inside = (np.arange(4) + 0.5) / 4
    design = np.zeros((cells, 4, cells + DEGREE))
    for k in range(cells):
        design[k, :, k : k + 4] = bspline(inside).T
    at = (np.arange(cells)[:, None] + inside).ravel() / cells
    return extent * (2 * at - 1), design.reshape(4 * cells, -1)
