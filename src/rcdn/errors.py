"""Errors that rcdn raises on purpose. Each message names the argument and the fix."""


class RcdnError(Exception):
    """Base of every error raised on purpose by rcdn."""


class ImageError(RcdnError):
    """A picture that can't be read or can't be used (missing, truncated, empty, wrong shape, not finite)."""


class ConfigError(RcdnError, ValueError):
    """A setting that is unknown or outside its range."""


class FormatError(RcdnError):
    """A file of detections, cameras or a calibration that can't be read, or a result that its format can't hold."""


class OutputError(RcdnError):
    """A result that can't be written (no space, no permission, no such folder)."""


class DependencyError(RcdnError, ImportError):
    """An optional dependency is missing; the message says which extra brings it."""


class CalibrationError(RcdnError):
    """Boards that don't settle a camera, a pose or a pair of cameras; the message says what pictures to take."""
