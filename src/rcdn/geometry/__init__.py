"""Homographies, lens models and poses. The only place where any of them lives."""

from rcdn.geometry.homography import apply_homography, homography
from rcdn.geometry.lens import project, transform, unproject
from rcdn.geometry.slopes import cross_matrix, project_with_slopes, rotation, rotation_slope

__all__ = [
    "apply_homography",
    "cross_matrix",
    "homography",
    "project",
    "project_with_slopes",
    "rotation",
    "rotation_slope",
    "transform",
    "unproject",
]
