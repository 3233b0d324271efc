"""The conda recipe asks for what pyproject.toml asks for, and its tests are commands that work."""

import re
import shlex
import tomllib

import yaml
from tests.doc_blocks import ROOT, run

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
RECIPE = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text())
OF_CONDA = {"opencv-python-headless": "py-opencv"}
"""packages that conda-forge calls otherwise"""


def of_conda(line):
    """A requirement of pip's as the recipe writes it."""
    name, rest = re.fullmatch(r"([\w-]+)(.*)", line).groups()
    return f"{OF_CONDA.get(name, name)} {rest}"


def test_the_same_version_and_requirements():
    project = PROJECT["project"]
    assert RECIPE["context"]["version"] == project["version"]
    assert RECIPE["requirements"]["run"] == ["python", *map(of_conda, project["dependencies"])]
    assert set(map(of_conda, PROJECT["build-system"]["requires"])) <= set(RECIPE["requirements"]["host"])
    assert (ROOT / RECIPE["about"]["license_file"]).is_file()


def test_its_commands_work(tmp_path):
    (script,) = [test["script"] for test in RECIPE["tests"] if "script" in test]
    for line in script:
        run(tmp_path, "-m", *shlex.split(line))
    assert (tmp_path / "camera.yaml").is_file()
