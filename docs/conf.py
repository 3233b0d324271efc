"""Sphinx: the site is the repository's own Markdown, at the same paths, with README.md as its first page.

`sphinx-build -c docs . build/site` in the repository's root. Links to what isn't on the site (code, records of
measurements) are left as text.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import rcdn

ROOT = Path(__file__).resolve().parents[1]

project = "rcdn"
author = "The rcdn contributors"
copyright = author
version = release = rcdn.__version__

root_doc = "README"
include_patterns = ["README.md", "CHANGELOG.md", "CONTRIBUTING.md", "docs/**.md"]
source_suffix = {".md": "markdown"}
extensions = ["myst_parser", "sphinx.ext.autodoc"]

html_theme = "furo"
html_title = f"rcdn {release}"
html_copy_source = html_show_sphinx = False
html_show_copyright = False

nitpicky = True
nitpick_ignore_regex = [  # types of other packages: nothing is fetched from the network to link them
    (r"py:.*", r"(np|numpy|npt|NDArray|Array|ArrayLike|Path|pathlib|Any|typing|collections|Callable|os|PathLike)\b.*"),
    (r"py:.*", r"'.*|[ \w]*'|rcdn\.types\.arrays\..*"),  # shapes of arrays
    (r"py:.*", r"rcdn\.types\.(base|named|plane)\..*|rcdn\.io\.finding\.Found"),
]
myst_heading_anchors = 6
myst_enable_extensions: list[str] = []
suppress_warnings = ["myst.header"]

default_role = "literal"  # `name` in docstrings
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
autodoc_preserve_defaults = True
autoclass_content = "class"

CONTENTS = """
```{toctree}
:hidden:
:caption: How to
:glob:

docs/how-to
docs/how-to/*
```
```{toctree}
:hidden:
:caption: What it does

docs/features
docs/python
docs/command-line
docs/calibration
docs/live
docs/rigs
docs/coded-boards
docs/adapters
docs/many-pictures
docs/install
docs/training
```
```{toctree}
:hidden:
:caption: Reference

docs/reference/detection
docs/reference/calibration
docs/reference/values
docs/reference/files
docs/conventions
docs/formats
docs/formulation
docs/pipeline
docs/constants
docs/glossary
```
```{toctree}
:hidden:
:caption: Measured

docs/results
docs/calibration-results
docs/speed
docs/recovery
docs/peers
docs/paper
docs/paper-results
```
```{toctree}
:hidden:
:caption: How it came about
:glob:

CHANGELOG
CONTRIBUTING
docs/log
docs/decisions/*
```
"""
LINK = re.compile(r"(!?)\[([^\]\n]*)\]\(([^)#\s]+)(#[^)\s]*)?\)")


def on_the_site(page: Path, link: str) -> bool:
    """Whether a link of a page leads to a page or a picture of the site, or elsewhere."""
    if re.match(r"[a-z]+:", link):
        return True
    target = Path(os.path.normpath(page.parent / link))
    name = target.relative_to(ROOT).as_posix() if target.is_relative_to(ROOT) else ""
    if not target.exists():
        return True  # Sphinx says so
    return (name.startswith(("docs/", "examples/")) and target.is_file()) or name in (
        "README.md",
        "CHANGELOG.md",
        "CONTRIBUTING.md",
    )


def adapt(app: Any, name: str, source: list[str]) -> None:
    """What differs from the forge: a table of contents, and no links to files that the site hasn't."""
    page = Path(app.env.doc2path(name))
    parts = re.split(r"(^```.*?^```$)", source[0], flags=re.M | re.S)
    for i in range(0, len(parts), 2):
        parts[i] = LINK.sub(lambda m: m[0] if m[1] or on_the_site(page, m[3]) else m[2], parts[i])
    source[0] = "".join(parts) + (CONTENTS if name == root_doc else "")


def setup(app: Any) -> dict[str, bool]:
    """Register `adapt`."""
    app.connect("source-read", adapt)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
