"""The rules of CONTRIBUTING.md: layers of imports, light imports, public names, links, and documented commands."""

import ast
import importlib
import re
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import rcdn

ROOT = Path(__file__).parents[1]
HEAVY = ("torch", "onnx", "matplotlib", "lightning_fabric", "lightning", "tensorboard")
LATE = ("numpy", "cv2", "scipy", "onnxruntime", "jinja2", "markupsafe")
"""packages that are imported where they are needed"""
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
INSTALL_AND_TEST = (
    'pip install "torch==2.13.0" && pip install -e ".[train,test]" -e lab && python -m pytest -n auto --dist loadgroup'
)
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def tool(name, *arguments):
    """Run a tool that is installed beside this Python; its output if it fails, else ''."""
    program = Path(sys.executable).parent / name
    if not program.exists():
        pytest.skip(f"{name} isn't installed: pip install -e '.[test]'")
    done = subprocess.run([str(program), *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout + done.stderr if done.returncode else ""


def run(code):
    """Standard output of a fresh interpreter."""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def loaded(code):
    """Which heavy packages `code` loads."""
    out = run(f"{code}\nimport sys\nprint('|', *[m for m in {HEAVY!r} if m in sys.modules])")
    return out.rsplit("|", 1)[1].split()


def test_imports_go_only_down():
    assert tool("lint-imports") == ""


def imports_of_modules(folder):
    """Which modules of the packages in `folder` each of them imports, also within functions and for types only."""
    files = {
        ".".join(f.relative_to(folder).with_suffix("").parts).removesuffix(".__init__"): f for f in folder.rglob("*.py")
    }
    graph = {}
    for name, file in files.items():
        taken = set()
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                taken |= {a.name for a in node.names}
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{name}: a relative import"
                of = {f"{node.module}.{a.name}" for a in node.names}
                taken |= of & set(files) or {node.module}
        graph[name] = (taken & set(files)) - {name}
    return graph


@pytest.mark.parametrize("folder", ["src", "lab/src"])
def test_no_circle_of_modules(folder):
    graph = imports_of_modules(ROOT / folder)
    assert sum(map(len, graph.values())) > 100
    while ends := [name for name, taken in graph.items() if not taken]:
        graph = {name: taken - set(ends) for name, taken in graph.items() if name not in ends}
    assert sorted(graph) == []


@pytest.mark.parametrize(
    "arguments",
    [
        ("ruff", "check", "."),
        ("ruff", "format", "--check", "."),
        ("mypy",),
        ("clang-format", "--dry-run", "-Werror", *map(str, sorted((ROOT / "src/native").glob("*.[ch]")))),
    ],
    ids=["lint", "format", "types", "C"],
)
def test_style(arguments):
    assert tool(*arguments) == ""


@pytest.mark.parametrize(
    "code",
    [
        "import rcdn",
        f"import rcdn; [getattr(rcdn, name) for name in {rcdn.__all__!r}]",
        "import rcdn.cli",
        "import rcdn.cli.detect, rcdn.cli.board",
        "import rcdn.detector, rcdn.boards, rcdn.synthetic, rcdn.report.overlay, rcdn.report.target",
    ],
)
def test_imports_are_light(code):
    assert loaded(code) == []


@pytest.mark.parametrize("arguments", [["--help"], ["detect", "--help"], ["board", "--help"], ["--version"]])
def test_the_command_line_is_light(arguments):
    start = f"import sys\nsys.argv = ['rcdn', *{arguments!r}]\nimport rcdn.cli"
    code = f"{start}\ntry:\n    rcdn.cli.main()\nexcept SystemExit as end:\n    assert not end.code"
    assert loaded(code) == []


def test_the_command_line_starts_without_numpy():
    """Each verb imports what it needs: help is quick, and a process can still say how many threads
    NumPy's BLAS may use."""
    assert run(f"import rcdn.cli, sys; print([m for m in {LATE!r} if m in sys.modules])") == "[]\n"


def test_import_loads_nothing_of_its_own():
    """Not even NumPy: names arrive at their first use."""
    assert run(f"import rcdn, sys; print([m for m in {LATE!r} if m in sys.modules])") == "[]\n"


def test_a_detector_loads_nothing_that_reads_or_writes_cameras():
    late = ["rcdn.io.cameras", "rcdn.io.calibration", "rcdn.io.rig_files", "rcdn.io.vnl", "rcdn.calibration"]
    assert run(f"import rcdn, sys; rcdn.Detector(); print([m for m in {late!r} if m in sys.modules])") == "[]\n"


@pytest.mark.parametrize("name", ["rcdn", "rcdn.calibration", "rcdn.io"])
def test_names_that_arrive_late_are_there(name):
    """In a fresh interpreter, so that no other import has brought them."""
    code = f"import {name} as it; print(all(n in dir(it) and getattr(it, n) is not None for n in it.__all__))"
    assert run(code) == "True\n"
    with pytest.raises(AttributeError, match=f"module '{name}' has no attribute 'nothing'"):
        import_module(name).nothing  # noqa: B018


def test_a_detector_of_plain_boards_needs_no_scipy():
    code = (
        "import rcdn, sys; "
        "rcdn.Detector(rcdn.DetectorConfig(threads=1)).boards(__import__('numpy').zeros((64, 64), 'uint8'))"
    )
    assert run(f"{code}; print([m for m in ('scipy', 'onnxruntime') if m in sys.modules])") == "[]\n"


def test_public_names():
    """A change of this list is a change of the API: say so in CHANGELOG.md."""
    assert sorted(rcdn.__all__) == [
        "Board", "Calibration", "Camera", "Corners", "Detection", "Detector", "DetectorConfig", "Pose", "RcdnError",
        "__version__", "calibrate", "calibrate_rig", "calibrate_stereo", "detect_charuco", "estimate_pose",
        "find_chessboard_corners", "read_image",
    ]  # fmt: skip
    assert dir(rcdn) == sorted(rcdn.__all__)


@pytest.mark.parametrize("name", rcdn.__all__)
def test_public_names_resolve_and_are_documented(name):
    value = getattr(rcdn, name)
    assert name == "__version__" or value.__doc__


def test_names_for_type_checkers_are_the_public_ones():
    tree = ast.parse((ROOT / "src/rcdn/__init__.py").read_text())
    guard = next(n for n in tree.body if isinstance(n, ast.If))
    imports = [n for n in guard.body if isinstance(n, ast.ImportFrom)]
    named = {(a.name, n.module) for n in imports for a in n.names}
    assert {name for name, _ in named} == set(rcdn.__all__) - {"__version__"}
    for name, module in named:
        assert getattr(importlib.import_module(module), name) is getattr(rcdn, name)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        rcdn.nothing  # noqa: B018


def test_one_version():
    assert PROJECT["project"]["version"] == rcdn.__version__
    assert f"## [{rcdn.__version__}]" in (ROOT / "CHANGELOG.md").read_text()
    assert f"version: {rcdn.__version__}\n" in (ROOT / "CITATION.cff").read_text()


def anchors(page):
    """Anchors of a page's headings, as GitHub makes them."""
    heads = re.findall(r"^#+ (.+)$", re.sub(r"^```.*?^```", "", page.read_text(), flags=re.M | re.S), flags=re.M)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in heads}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    text = re.sub(r"^```.*?^```|`[^`\n]*`", "", page.read_text(), flags=re.M | re.S)
    links = re.findall(r"\]\(\s*<?([^)>\s]+)", text) + re.findall(r'(?:src|href)="([^"]+)"', text)
    for link in links:
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = unquote(link).partition("#")
        target = page.parent / path if path else page
        assert target.exists(), f"{page.name}: {link}"
        if anchor and target.suffix == ".md":
            assert anchor in anchors(target), f"{page.name}: {link}"


@pytest.mark.parametrize(
    "page", [ROOT / "docs/paper.md", *sorted((ROOT / "docs/decisions").glob("*.md"))], ids=lambda p: p.stem
)
def test_functions_and_tests_that_are_named_exist(page):
    """`corners/nms.py:nms` is a name in src/rcdn, `rcdn_lab/…` in lab/src,
    `tests/…/test_x.py::test_y` (or ::*) a test."""
    text = page.read_text()
    for path, name in re.findall(r"`([\w/]+\.py):(\w+)`", text):
        source = (ROOT / ("lab/src" if path.startswith("rcdn_lab/") else "src/rcdn") / path).read_text()
        assert re.search(rf"^(?:def |class |    def )?{name}\b", source, flags=re.M), f"{path}:{name}"
    for path, name in re.findall(r"`((?:lab/)?tests/[\w/]+\.py)(?:::(\w+))?`", text):
        assert f"def {name or 'test_'}" in (ROOT / path).read_text(), f"{path}::{name}"


def test_ci_runs_what_the_readme_says():
    assert INSTALL_AND_TEST in (ROOT / ".ci/run").read_text().splitlines()
    readme = (ROOT / "README.md").read_text()
    if "```" not in readme:
        pytest.skip("README.md has no commands yet")
    assert INSTALL_AND_TEST in readme


def test_the_slow_tests_exist():
    listed = [line for line in (ROOT / "tests/slow_tests.txt").read_text().splitlines() if not line.startswith("#")]
    assert listed == sorted(set(listed))
    slow = {}
    for test in listed:
        path, name = test.split("::")
        slow.setdefault(path, set()).add(name)
    for path, names in slow.items():
        tree = ast.parse((ROOT / path).read_text())
        there = {f.name for f in ast.walk(tree) if isinstance(f, ast.FunctionDef) and f.name.startswith("test_")}
        assert names <= there, f"{path}: {names - there}"


def test_extras_of_the_command_exist():
    wanted = re.search(r"\[([\w,]+)\]", INSTALL_AND_TEST)[1].split(",")
    assert set(wanted) <= set(PROJECT["project"]["optional-dependencies"])


PLAIN_PAGES = {"CHANGELOG.md", "CONTRIBUTING.md", "docs/log.md", "docs/how-to.md"}
"""lists, in which a picture would say nothing"""


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_pages_have_a_small_picture_that_says_what_it_shows(page):
    name = page.relative_to(ROOT).as_posix()
    pictures = re.findall(r"!\[([^\]]*)\]\(([^)]+)\)", page.read_text())
    assert pictures or name in PLAIN_PAGES or name.startswith("docs/decisions/")
    for words, path in pictures:
        assert len(words) > 10, path
        assert (page.parent / path).stat().st_size < 300_000, path


def test_links_to_elsewhere_are_whole_addresses():
    """Whether they answer, `sphinx-build -b linkcheck` says, where there is a network (CONTRIBUTING.md)."""
    found = {link for page in PAGES for link in re.findall(r"(?:\]\(|<|\")(https?:[^)>\"\s]*)", page.read_text())}
    assert found
    for link in found:
        parts = urlsplit(link)
        assert parts.scheme == "https", link
        assert re.fullmatch(r"([a-z0-9-]+\.)+[a-z]{2,}", parts.hostname or ""), link
        assert parts.username is None, link
        assert not link.endswith((".", ",", ";", ":")), link
