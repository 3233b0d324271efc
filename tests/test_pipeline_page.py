"""docs/pipeline.md, the map of the code: its links lead somewhere, and every module of a stage,
every kernel and their tests are on it."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/pipeline.md").read_text("utf-8")
LINKS = [(ROOT / "docs" / link).resolve() for link in re.findall(r"\]\(([^)#]+)", PAGE) if not link.startswith("http")]
STAGES = ("corners", "boards", "precision", "targets")


def test_every_link_leads_to_a_file():
    assert [str(link.relative_to(ROOT)) for link in LINKS if not link.exists()] == []


@pytest.mark.parametrize("stage", STAGES)
def test_every_module_of_a_stage_is_on_the_map(stage):
    modules = sorted((ROOT / "src/rcdn" / stage).glob("*.py"))
    missing = [path.stem for path in modules if path not in LINKS and path.name != "__init__.py"]
    assert missing == []


def test_every_kernel_is_on_the_map():
    assert [path.name for path in sorted((ROOT / "src/native").glob("*.c")) if path not in LINKS] == []


@pytest.mark.parametrize("stage", ["corners", "boards", "precision"])
def test_every_test_of_a_stage_is_on_the_map(stage):
    assert [path.name for path in sorted((ROOT / "tests" / stage).glob("test_*.py")) if path not in LINKS] == []


def test_words_of_the_glossary_are_in_the_modules_that_it_names():
    text = (ROOT / "docs/glossary.md").read_text("utf-8")
    rows = re.findall(r"^\| ([^|]+) \| [^|]+ \| ([^|]+) \|$", text, flags=re.M)[1:]
    assert len(rows) > 30
    for word, places in rows:
        stem = re.sub(r" \(.*\)", "", word).strip()
        for place in re.findall(r"`([^`]+)`", places):
            path = ROOT / "src" / (place if place.startswith("native") else f"rcdn/{place}")
            files = [path] if path.is_file() else sorted(path.glob("*.py"))
            assert files, place
            assert any(stem.rstrip("e") in file.read_text("utf-8").lower() for file in files), (word, place)
