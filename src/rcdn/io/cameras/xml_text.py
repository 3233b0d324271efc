"""Reading OpenCV's XML, as cv2.FileStorage writes it to files called .xml."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

from rcdn.errors import FormatError
from rcdn.io.cameras.yaml_text import Matrix

ROOT = "opencv_storage"
"""name of the outermost element"""
_MATRICES = {"opencv-matrix", "opencv-nd-matrix"}


def is_xml(text: str) -> bool:
    """Whether a text is OpenCV's XML."""
    return text.lstrip("\ufeff \r\n").startswith("<") and f"<{ROOT}" in text[:2000]


def load(path: str, text: str) -> dict[str, Any]:
    """The numbers, matrices and texts of a file by name, as `yaml_text.load` gives them; lists and maps are left out.

    Raises FormatError with the line of the error, and for a DOCTYPE, whose entities could expand to any length.
    """
    if "<!DOCTYPE" in text:
        raise FormatError(f"{path}: holds a DOCTYPE, which OpenCV doesn't write; remove it, or export the file again")
    try:
        root = ElementTree.fromstring(text.lstrip("\ufeff \r\n").encode())
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise FormatError(f"{path}: not XML ({error}); mend that line, or export the file again") from error
    return {each.tag: _value(each) for each in root if not len(each) or each.get("type_id") in _MATRICES}


def _value(element: ElementTree.Element) -> Any:
    text = (element.text or "").strip()
    if len(element):
        fields = {part.tag: (part.text or "").split() for part in element}
        return Matrix({k: v if k in ("data", "sizes") else " ".join(v) for k, v in fields.items()})
    for number in (int, float):
        try:
            return number(text)
        except ValueError:
            continue
    return text.strip('"')
