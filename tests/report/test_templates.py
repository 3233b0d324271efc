"""The templates of the pages: what they do with text, what they refuse, and that each of them is used."""

import base64
import hashlib
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jinja2 import UndefinedError
from markupsafe import Markup
from test_calibration_report import BROWN, Page, photograph, simulated, simulated_pair
from test_rig_again import whole

from rcdn.calibration.comparison import compare
from rcdn.report.calibration import comparison, page, write_report, write_rig_report, write_stereo_report
from rcdn.report.calibration.environment import FOLDER, SCRIPTS, STYLES, environment, policy, render

NAME = '<script>alert("x")</script>.png'


def filled(source, **payload):
    """A template given as text, filled."""
    return environment().from_string(source).render(payload)


def named(calibration):
    """The calibration with pictures whose names are code."""
    views = tuple(replace(v, name=f"{k}{NAME}") for k, v in enumerate(calibration.views))
    return replace(calibration, views=views)


def camera(path):
    write_report(path, named(simulated(many=6)), lambda name: photograph(), title=NAME)


def pair(path):
    found = simulated_pair(noise=0.1, many=6)
    found = replace(found, left=named(found.left), right=named(found.right))
    write_stereo_report(path, found, lambda name: photograph(), lambda name: photograph(), title=NAME)


def rig(path):
    found = whole()
    found = replace(found, cameras={name: named(c) for name, c in found.cameras.items()})
    write_rig_report(path, found, {name: lambda _: photograph() for name in found.cameras}, title=NAME)


def compared(path):
    moved = replace(BROWN, K=BROWN.K + np.diag([5.0, 5.0, 0]))
    comparison.write_comparison_report(path, compare(BROWN, moved), (NAME, NAME), title=NAME)


PAGES = (camera, pair, rig, compared)


@pytest.mark.parametrize("made", PAGES)
def test_code_in_names_is_text_on_every_page(tmp_path, made):
    made(tmp_path / "page.html")
    shown = Page((tmp_path / "page.html").read_text("utf-8"))
    assert shown.tags.count("script") == 1
    assert shown.text.count(NAME) >= 4


def test_every_template_is_on_a_page(tmp_path):
    environment().cache.clear()
    for made in PAGES:
        made(tmp_path / "page.html")
    used = {name for _, name in environment().cache.keys()}  # noqa: SIM118
    assert used == {file.name for file in FOLDER.glob("*.jinja")}
    assert {*used, *STYLES, *SCRIPTS} == {file.name for file in FOLDER.iterdir()}


def test_values_are_escaped_and_invisible_characters_seen():
    assert filled("<p>{{ text }}</p>", text="<b>&\u202e\n") == "<p>&lt;b&gt;&amp;\\u202e␊</p>"
    assert filled('<p id="{{ text }}">', text="\"'") == '<p id="&#34;&#39;">'
    assert filled("{{ art }}", art=Markup("<svg></svg>\n")) == "<svg></svg>\n"
    assert filled("{{ text | lines }}", text="<\n>") == "&lt;\n&gt;"
    assert filled("{{ 'a<' ~ text }}", text="\n") == "a&lt;␊"


@pytest.mark.parametrize("source", ["{{ nothing }}", "{{ some.nothing }}", "{% if nothing %}{% endif %}"])
def test_a_missing_value_raises(source):
    with pytest.raises(UndefinedError, match="nothing"):
        filled(source, some={})


def test_none_is_a_missing_value():
    with pytest.raises(TypeError, match="None"):
        filled("{{ nothing }}", nothing=None)


def test_a_page_without_its_payload_raises():
    with pytest.raises(UndefinedError):
        render("camera", title="Camera")


def test_numbers_are_formatted_by_filters():
    assert (
        filled("{{ a | pixels }}, {{ a | number(2) }}, {{ b | percent }}", a=0.12345, b=0.71) == "0.123 px, 0.12, 71 %"
    )
    assert (
        filled("{{ n | counted('view was', 'views were') }}, {{ n | thousands }}", n=1234) == "1,234 views were, 1,234"
    )
    assert filled("{{ 1 if a is finite else 0 }}{{ 1 if b is finite else 0 }}", a=2.0, b=float("nan")) == "10"


def test_only_the_script_of_the_page_may_run(tmp_path):
    camera(tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text("utf-8")
    (code,) = re.findall(r"<script>(.*?)</script>", text, re.S)
    assert f"'sha256-{base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()}'" in policy()
    assert Page(text).values("content")[0] == policy()


def test_photographs_are_read_once_and_once_for_the_sample():
    names = []
    page.report(simulated(many=5), lambda name: names.append(name) or photograph())
    assert len(names) == 6


def test_the_templates_are_in_the_wheel():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())
    patterns = project["tool"]["setuptools"]["package-data"]["rcdn"]
    place = FOLDER.relative_to(FOLDER.parents[2])
    assert all(any((place / file.name).match(p) for p in patterns) for file in FOLDER.iterdir())


def test_jinja_is_imported_with_the_first_page():
    code = "import sys, rcdn.report.calibration.comparison; print('jinja2' in sys.modules)"
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "False\n"
