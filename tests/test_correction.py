"""The smooth correction of a lens: slopes against differences, there and back, its grid and its roughness."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline

from rcdn.errors import RcdnError
from rcdn.geometry import (
    basis,
    folds,
    project,
    project_with_jacobian,
    roughness,
    stereographic,
    surface,
    unproject,
    zero_correction,
)
from rcdn.geometry.correction import point_of, stereographic_jacobian, surface_jacobian
from rcdn.geometry.inverse import unfolded
from rcdn.geometry.models import fold
from rcdn.geometry.undistort import NOWHERE, undistortion_maps
from rcdn.types import Camera, LensCorrection

SIZE = (640, 480)
K = np.array([[410.0, 0, 322], [0, 405, 243], [0, 0, 1]])
BASES = [
    Camera(K, [], SIZE, "pinhole"),
    Camera(K, [-0.2, 0.04, 0.002, -0.001], SIZE, "brown"),
    Camera(K, [-0.2, 0.04, 0.002, -0.001, 0.001], SIZE, "brown"),
    Camera(K, [0.4, -0.05, 0.002, -0.003, 0.01, 0.75, 0.05, -0.002], SIZE, "rational"),
    Camera(K, [0.03, -0.008, 0.002, -0.0005], SIZE, "fisheye"),
]
each_base = pytest.mark.parametrize("base", BASES, ids=lambda c: f"{c.model}{len(c.distortion)}")


def corrected(base, amplitude=0.004, columns=8, seed=0):
    """`base` with random control points, focal lengths."""
    grid = zero_correction(base, columns)
    control = amplitude * np.random.default_rng(seed).normal(size=grid.control.shape)
    return replace(base, correction=grid.with_control(control))


def frame(camera, along=25):
    x, y = (np.linspace(-0.5, n - 0.5, along) for n in camera.image_size)
    return np.stack(np.meshgrid(x, y), axis=-1)


def differences(function, x, step=1e-6):
    """Central differences (..., len(x)) of `function` at the vector `x`."""
    steps = step * np.eye(len(x))
    return np.stack([(function(x + d) - function(x - d)) / (2 * step) for d in steps], axis=-1)


@each_base
def test_slopes_are_those_of_differences(base):
    """In the domain, beyond it and on the axis."""
    camera = corrected(base)
    z = np.random.default_rng(1).uniform(0.5, 3, 30)
    p = np.random.default_rng(2).uniform(-1.6, 1.6, (30, 3)) * z[:, None]
    p[:, 2], p[0, :2] = z, 0
    inside = (np.abs(stereographic(p)) < camera.correction.extent).all(axis=1)
    assert 5 < inside.sum() < 25
    xy, by_point, by_parameter = project_with_jacobian(camera, p)
    assert np.array_equal(xy, project(camera, p))
    for k in range(len(p)):
        assert by_point[k] == pytest.approx(differences(lambda q: project(camera, q), p[k]), abs=3e-5, rel=1e-6)
    moved = differences(lambda a: project(camera.with_parameters(a), p), camera.parameters)
    assert by_parameter == pytest.approx(moved, abs=3e-5, rel=1e-6)


def test_fisheye_slopes_hold_beside_and_behind_the_camera():
    camera = corrected(BASES[-1])
    p = np.array([[1.0, 0.2, 0.0], [0.8, -0.6, -0.2], [-1.0, 0.1, -0.5], [0.1, 0.2, -2.0]])
    _, by_point, _ = project_with_jacobian(camera, p)
    for k in range(len(p)):
        assert by_point[k] == pytest.approx(differences(lambda q: project(camera, q), p[k]), abs=3e-5)
        assert stereographic_jacobian(p[k]) == pytest.approx(differences(stereographic, p[k]), abs=1e-6)
    assert stereographic(point_of(stereographic(p))) == pytest.approx(stereographic(p))


@each_base
def test_there_and_back(base):
    """Every pixel that has a ray without the correction has one with it, and the ray sees the pixel."""
    camera = corrected(base)
    assert not folds(camera)
    assert unfolded(base, unproject(base, frame(base))).all()
    pixels = frame(camera)
    rays = unproject(camera, pixels)
    assert rays.shape == (*pixels.shape[:-1], 3)
    assert np.isfinite(unproject(base, pixels)).all()
    assert project(camera, rays) == pytest.approx(pixels, abs=1e-8)
    length = np.linalg.norm(rays, axis=-1) if base.model == "fisheye" else rays[..., 2]
    assert length == pytest.approx(1, abs=1e-14)
    assert unproject(camera, pixels[3, 4]) == pytest.approx(rays[3, 4], abs=1e-12)
    assert np.isnan(unproject(camera, np.array([[np.nan, 3.0]]))).all()
    assert unproject(camera, np.zeros((0, 2))).shape == (0, 3)


@each_base
def test_without_control_points_nothing_changes(base):
    camera = replace(base, correction=zero_correction(base, 7))
    pixels = frame(base)
    rays = unproject(base, pixels)
    assert unproject(camera, pixels) == pytest.approx(rays, abs=1e-11)
    np.testing.assert_array_equal(project(camera, rays), project(base, rays))


def test_an_affine_correction_is_a_large_change_that_is_found_back():
    """S = A·u + b has an inverse that Newton finds although it starts far away."""
    base = BASES[0]
    grid = zero_correction(base, 6)
    rows, columns, _ = grid.control.shape
    x, y = ((np.arange(n) - (n - 1) / 2) * h for n, h in zip((columns, rows), grid.sides, strict=True))
    A, b = np.array([[0.6, -0.3], [0.2, 0.5]]), np.array([0.2, -0.1])
    net = np.stack(np.meshgrid(x, y), axis=-1) @ A.T + b
    camera = replace(base, correction=grid.with_control(net))
    u = np.random.default_rng(0).uniform(-1, 1, (50, 2)) * grid.extent
    assert surface(camera.correction, u) == pytest.approx(u @ A.T + b, abs=1e-12)
    rays = point_of(u) / point_of(u)[:, 2:]
    assert unproject(camera, project(camera, rays)) == pytest.approx(rays, abs=1e-9)


def test_a_map_that_is_turned_over_has_no_rays_there():
    base = BASES[0]
    control = zero_correction(base, 12).control.copy()
    control[5:7, 5:7] += 3.0
    camera = replace(base, correction=zero_correction(base, 12).with_control(control))
    rays = unproject(camera, frame(camera, 60).reshape(-1, 2))
    seen = rays[np.isfinite(rays).all(axis=1)]
    assert 0 < len(seen) < len(rays)
    _, by_point, _ = project_with_jacobian(camera, seen)
    assert (np.linalg.det(by_point[:, :, :2]) > 0).all()
    assert folds(camera)
    wide = replace(base, K=K * [[1.2], [1.2], [1]])
    lost = [(undistortion_maps(c, wide)[0] == NOWHERE).mean() for c in (camera, replace(base, correction=None))]
    assert 0.01 < lost[0] < 0.5
    assert lost[1] == 0


@pytest.mark.parametrize("base", [BASES[0], BASES[-1]], ids=["pinhole", "fisheye"])
def test_beyond_the_domain_the_map_is_continuous_and_never_folds(base):
    camera = corrected(base, 0.01)
    extent = camera.correction.extent
    edge = np.stack([np.full(50, extent[0]), np.linspace(-1, 1, 50) * extent[1]], axis=-1)
    at, far = surface(camera.correction, edge), surface(camera.correction, 3 * edge)
    assert far == pytest.approx(at, abs=1e-12)
    assert surface(camera.correction, edge * (1 + 1e-9)) == pytest.approx(at, abs=1e-8)
    angle = np.linspace(0, 2 * np.pi, 200)[:, None]
    widest = 2 * np.tan(0.49 * fold(base))  # nearly where the parametric lens itself ends
    radius = np.linspace(np.linalg.norm(extent), widest, 60)
    u = (radius * np.stack([np.cos(angle), np.sin(angle)])).reshape(2, -1).T
    p = point_of(u)
    _, by_point, _ = project_with_jacobian(camera, p)
    J = by_point[:, :, :2] - by_point[:, :, 2:] * (u / 2)[:, None]
    assert (np.linalg.det(J) > 0).all()


def test_the_surface_is_the_product_of_cubic_splines():
    correction = corrected(BASES[0], 1.0).correction
    rows, columns, _ = correction.control.shape
    u = np.random.default_rng(3).uniform(-1, 1, (100, 2)) * correction.extent
    design = [
        BSpline.design_matrix(u[:, axis], side * (np.arange(n + 4) - 3) - extent, 3).toarray()
        for axis, n, side, extent in zip((0, 1), (columns, rows), correction.sides, correction.extent, strict=True)
    ]
    expected = np.einsum("nc,nr,rck->nk", *design, correction.control)
    assert surface(correction, u) == pytest.approx(expected, abs=1e-12)
    assert surface_jacobian(correction, u)[0] == pytest.approx(expected, abs=1e-12)
    used, weights = basis(correction, point_of(u))
    assert weights.sum(axis=1) == pytest.approx(1)
    assert (weights[:, :, None] * correction.control.reshape(-1, 2)[used]).sum(axis=1) == pytest.approx(expected)


def test_roughness_is_the_bending_energy():
    """∬ S_uu² + 2 S_uv² + S_vv² of S = (u², uv) is (4 + 2)·area; it is zero for affine nets and for nothing else."""
    grid = LensCorrection(np.zeros((6, 9, 2)), [0.9, 0.45])
    rows, columns, _ = grid.control.shape
    hx, hy = grid.sides
    x, y = np.meshgrid((np.arange(columns) - 4) * hx, (np.arange(rows) - 2.5) * hy)
    form = roughness(grid)
    area = 4 * np.prod(grid.extent)
    square = np.stack([x * x - hx * hx / 3, x * y], axis=-1).ravel()  # the control points of (u², uv)
    assert surface(grid.with_control(square), np.array([[0.3, -0.2]]))[0] == pytest.approx([0.09, -0.06])
    assert square @ form @ square == pytest.approx(6 * area)
    affine = np.stack([1 + 2 * x - 3 * y, 0.5 - x + y], axis=-1).ravel()
    assert np.abs(form @ affine).max() < 1e-11 * np.abs(form).max()
    values = np.linalg.eigvalsh(form)
    assert values[:6] == pytest.approx(0, abs=1e-11 * values[-1])
    assert values[6] > 1e-6 * values[-1]


@each_base
def test_the_grid_covers_the_frame_with_square_cells(base):
    grid = zero_correction(base, 9, margin=0.05)
    assert grid.control.shape[1] == 9
    assert not grid.control.any()
    assert grid.sides[0] == pytest.approx(grid.sides[1])
    most = np.abs(stereographic(unproject(base, frame(base)))).max(axis=(0, 1))
    assert grid.extent[0] == pytest.approx(1.1 * most[0], rel=0.01)
    assert 1.1 * most[1] <= grid.extent[1] * 1.001 <= 1.1 * most[1] + grid.sides[1]


def test_a_frame_with_corners_without_rays_is_covered_as_far_as_there_are_rays():
    folded = Camera(K, [-0.4, 0, 0, 0], SIZE)
    assert np.isnan(unproject(folded, frame(folded))).any()
    assert np.isfinite(zero_correction(folded, 8).extent).all()
    small = zero_correction(BASES[0], 8, pixels=np.array([[300.0, 200], [340, 260]]))
    assert small.extent[0] < 0.1


def test_parameters_keep_their_layout():
    camera = corrected(BASES[1])
    names = camera.parameter_names
    assert len(names) == len(set(names)) == len(camera.parameters)
    assert names[8:11] == ("s00x", "s00y", "s01x")
    back = camera.with_parameters(camera.parameters)
    np.testing.assert_array_equal(back.correction.control, camera.correction.control)
    np.testing.assert_array_equal(back.correction.extent, camera.correction.extent)
    np.testing.assert_array_equal(back.distortion, camera.distortion)
    changed = camera.with_parameters(np.arange(len(names)) + 1.0)
    assert changed.correction.control[0, 1].tolist() == [11, 12]


def test_wrong_corrections_are_refused():
    fine = LensCorrection(np.zeros((4, 5, 2)), [1, 1])
    with pytest.raises(RcdnError, match="division"):
        Camera(K, [-0.1], SIZE, "division", fine)
    with pytest.raises(RcdnError, match=r"rows ≥ 4, columns ≥ 4"):
        LensCorrection(np.zeros((3, 5, 2)), [1, 1])
    with pytest.raises(RcdnError, match="extent"):
        LensCorrection(np.zeros((4, 5, 2)), [1, -1])
    with pytest.raises(RcdnError, match="numbers"):
        fine.with_control(np.zeros(3))
    with pytest.raises(RcdnError, match="columns"):
        zero_correction(BASES[0], 3)
