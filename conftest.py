"""Fixtures of the whole test run."""

import gc
import os
import re
import signal
from importlib.util import find_spec
from pathlib import Path

import pytest
from hypothesis import settings

if "PYTEST_XDIST_WORKER" in os.environ:  # a process a core: none takes more threads for its linear algebra
    os.environ.setdefault("OMP_NUM_THREADS", "1")

if find_spec("jaxtyping") and find_spec("beartype") and os.environ.get("RCDN_SHAPES") != "off":
    from tests import shape_checks

    shape_checks.install()

gc.disable()  # what is made while tests are collected stays; to search it for garbage takes a third of the time

settings.register_profile("fixed", derandomize=True)  # the same examples in every run
settings.load_profile("fixed")

# a run in the background of a shell ignores Ctrl-C, and so would the processes that tests start and stop
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).parent
SLOW_TESTS = ROOT / "tests" / "slow_tests.txt"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real photographs with their `truth.json`, not in the repository; without it the test is skipped.

    It is `data` in the folder that RCDN_SHARED names, or in `shared` beside the repository.
    """
    shared = Path(os.environ.get("RCDN_SHARED") or ROOT.parent / "shared")
    if not (shared / "data" / "truth.json").is_file():
        pytest.skip(
            f"no real photographs: {shared}/data/truth.json is absent; set RCDN_SHARED to the folder above data"
        )
    return shared / "data"


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Run `rcdn ARGUMENTS` in a temporary folder."""
    from typer.testing import CliRunner

    from rcdn.cli import app

    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)


def pytest_collection_finish() -> None:
    """From here on garbage is collected, but what is there now isn't searched for any."""
    gc.freeze()
    gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests of other detectors are `peers`; those of tests/slow_tests.txt are `slow`."""
    slow = {line for line in SLOW_TESTS.read_text().splitlines() if not line.startswith("#")}
    for item in items:
        if re.split(r"[\[@]", item.nodeid)[0] in slow:
            item.add_marker("slow")
        if ROOT / "lab" / "tests" / "peers" in item.path.parents:
            item.add_marker("peers")
