"""Homographies, lens models and poses. Each of them is implemented in this package only."""

from rcdn.geometry.correction import basis, stereographic, surface
from rcdn.geometry.homography import apply_homographies, apply_homography, homography
from rcdn.geometry.jacobians import core_jacobian, cross_matrix, project_with_jacobian, rotation
from rcdn.geometry.lens import project, transform, unproject
from rcdn.geometry.spline_grid import folds, largest_shift, roughness, zero_correction
from rcdn.geometry.usable_lens import lens_trouble

__all__ = [
    "apply_homographies",
    "apply_homography",
    "basis",
    "core_jacobian",
    "cross_matrix",
    "folds",
    "homography",
    "largest_shift",
    "lens_trouble",
    "project",
    "project_with_jacobian",
    "rotation",
    "roughness",
    "stereographic",
    "surface",
    "transform",
    "unproject",
    "zero_correction",
]
