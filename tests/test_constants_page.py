"""docs/constants.md, the sources of the constants: every constant of detection is there with its present
value, and nothing else is."""

import ast
import dataclasses
import importlib
import re
from collections import Counter
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from rcdn import config

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/constants.md").read_text("utf-8")
STAGES = ("corners", "boards", "precision", "targets")
MODULES = sorted(path for stage in STAGES for path in (ROOT / "src/rcdn" / stage).glob("*.py"))
MODULES += [ROOT / "src/rcdn" / f"{name}.py" for name in ("views", "pyramid", "detector", "config")]
MACHINERY = {"elementary.c", "elementary.h", "kernel.h", "lanes.h", "levels.c", "levels.h", "maths.h", "module.c"}
"""what of src/native holds no constants of detection: calls of kernels, levels of processors,
series of elementary functions"""
CALIBRATION = {"lens.c", "normal.c", "plane_pose.c", "rigid.c"}
"""kernels of calibrations, whose constants are not those of detection"""
RENDERING = {"sheet.c"}
"""kernels of rendered pictures, likewise"""
SOURCES = ("*derived*", "*paper*", "*experiment*", "*noted*", "*convention*", "*not measured: chosen by hand*")
BRACES = r"\{(?:[^{}]|\{[^{}]*\})*\}"
IN_C = re.compile(
    r"^#define ([A-Z][A-Z_0-9]*) +([-(\d].*?) *(?:/\*.*)?$|\benum \{([^}]*)\}|static const \w+ ([^;]*?);", re.M
)


def numeric(value):
    """Is it a number, or nothing but numbers?"""
    if isinstance(value, tuple):
        return len(value) > 0 and all(map(numeric, value))
    if isinstance(value, np.ndarray):
        return value.size > 0 and value.dtype.kind in "iuf"
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)


def written(source, node, module):
    """An expression as the code has it, on one line, with numbers for what comes from C."""
    text = " ".join(ast.get_source_segment(source, node).split())
    return re.sub(r'(?:constants\("\w+"\)|_[A-Z]+)\["\w+"\]', lambda m: str(eval(m[0], vars(module))), text)


def of_module(path):
    """(name, value) of the numeric constants that a module of Python defines, as the page writes them."""
    source = path.read_text("utf-8")
    module = importlib.import_module(
        ".".join(path.relative_to(ROOT / "src").with_suffix("").parts).removesuffix(".__init__")
    )
    out = []
    for node in ast.parse(source).body:
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        )
        for target in targets:
            names = target.elts if isinstance(target, ast.Tuple) else [target]
            values = (
                node.value.elts if isinstance(node.value, ast.Tuple) and len(names) > 1 else [node.value] * len(names)
            )
            for name, value in zip(names, values, strict=True):
                if not (isinstance(name, ast.Name) and name.id.isupper() and not name.id.startswith("_")):
                    continue
                if numeric(found := getattr(module, name.id)):
                    alone = len(names) == 1 or isinstance(node.value, ast.Tuple)
                    out.append((name.id, written(source, value, module) if alone else repr(found)))
    return out


def of_kernel(path):
    """(name, value) of the numbers with a name in a file of C, as the code has them."""
    out = []
    for name, value, members, constants in IN_C.findall(path.read_text("utf-8")):
        if name:
            out.append((name, value))
        for member in re.sub(r"/\*.*?\*/", "", members, flags=re.S).split(","):
            if " = " in member:
                out.append(tuple(" ".join(member.split()).split(" = ", 1)))
        out += re.findall(rf"(\w+)(?:\[[^\]]*\])* = ({BRACES}|[^,{{]+)", " ".join(constants.split()))
    return out


def settings(value, name):
    """(name, value) of the numbers of a dataclass of settings and of those in it."""
    out = []
    for field in dataclasses.fields(value):
        own = getattr(value, field.name)
        if dataclasses.is_dataclass(own):
            out += settings(own, f"{name}.{field.name}")
        elif numeric(own):
            out.append((f"{name}.{field.name}", repr(own)))
    return out


def of_settings():
    """(name, value) of the defaults of all types of settings, and of what the presets have instead."""
    types = (*get_args(config.Threshold), config.Nms, config.Cluster)
    defaults = [pair for kind in types for pair in settings(kind(), kind.__name__)]
    auto, paper = (dict(settings(getattr(config.DetectorConfig, name)(), name)) for name in ("auto", "paper"))
    own = {name.split(".", 1)[1]: value for name, value in auto.items() if name.count(".") == 1}
    kinds = {"threshold": "Adaptive", "nms": "Nms", "cluster": "Cluster"}
    standard = own | {
        f"{part}.{name.split('.')[1]}": value
        for part, kind in kinds.items()
        for name, value in defaults
        if name.startswith(kind)
    }
    defaults += [(f"DetectorConfig.{name}", value) for name, value in own.items()]
    return defaults + [
        (name, value) for name, value in (auto | paper).items() if standard.get(name.split(".", 1)[1]) != value
    ]


def in_the_code():
    """Counts of (file, name, value) of every constant of detection."""
    found = [(path, pair) for path in MODULES for pair in of_module(path)]
    found += [
        (path, pair)
        for path in sorted((ROOT / "src/native").glob("*.[ch]"))
        if path.name not in MACHINERY | CALIBRATION | RENDERING
        for pair in of_kernel(path)
    ]
    found += [(ROOT / "src/rcdn/config.py", pair) for pair in of_settings()]
    return Counter((path.relative_to(ROOT / "src").as_posix(), *pair) for path, pair in found)


def rows():
    """Cells of the rows of the page's tables that tell constants."""
    return [
        [cell.strip() for cell in line.strip("|").split(" | ")] for line in re.findall(r"^\| \[.*$", PAGE, flags=re.M)
    ]


def on_the_page():
    """Counts of (file, name, value) of every constant that the page lists."""
    out = Counter()
    for where, values, *_ in rows():
        path = re.search(r"\]\(\.\./src/([^)]+)\)", where)[1]
        names, values = re.findall(r"`([^`]+)`", where), re.findall(r"`([^`]+)`", values)
        out.update((path, *pair) for pair in zip(names, values, strict=True))
    return out


def test_every_constant_is_on_the_page_with_its_value():
    assert sorted((in_the_code() - on_the_page()).elements()) == []


def test_every_constant_of_the_page_is_in_the_code():
    assert sorted((on_the_page() - in_the_code()).elements()) == []


def test_every_row_has_a_meaning_and_a_source():
    for where, _, meaning, source in rows():
        assert len(meaning) > 2, where
        assert source.startswith(SOURCES), (where, source)


def test_the_counts_that_the_page_tells_are_those_of_its_rows():
    counts = Counter()
    for where, _, _, source in rows():
        counts[next(kind for kind in SOURCES if source.startswith(kind))] += len(re.findall(r"`[^`]+`", where))
    stated = {kind: int(count) for kind, count in re.findall(r"^\| (\*[^*|]+\*) \| (\d+) \|", PAGE, flags=re.M)}
    assert stated == counts


def test_constants_are_found(tmp_path):
    path = tmp_path / "x.c"
    path.write_text(
        "#define A 3 /* px */\n#define F(x) (x)\nenum {\n  B = 2 * A, /* so, many */\n  C,\n};\n"
        "static const double d[2] = {1, 2}, e = .5;\n"
    )
    assert of_kernel(path) == [("A", "3"), ("B", "2 * A"), ("d", "{1, 2}"), ("e", ".5")]
    found = dict(of_module(ROOT / "src/rcdn/corners/peaks.py"))
    assert found["RING_SHARE"] == "0.35"
    assert found["RING"] == "(3.0, 16.0)"
    assert dict(of_module(ROOT / "src/rcdn/boards/edges.py"))["STEPS"] == "35"


@pytest.mark.parametrize(
    ("value", "is_one"), [(1, True), (True, False), ((1, (2.0,)), True), ((), False), ("1", False)]
)
def test_numeric(value, is_one):
    assert numeric(value) == is_one
