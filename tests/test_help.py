"""The help's groups, and shell completion as a shell asks for it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib.metadata import EntryPoints, entry_points

import pytest
from typer.testing import CliRunner

from rcdn.cli import app
from rcdn.io.cameras import names_of
from rcdn.terminal.group import VERBS

USERS = ["detect", "calibrate", "live", "pose", "board", "undistort"]


def groups(text):
    """Title → verbs of the help of `rcdn`."""
    found = {}
    for block in text.split("\n\n"):
        title, *rows = block.strip("\n").splitlines()
        if title.endswith(":"):
            found[title] = [row.split()[0] for row in rows]
    return found


def test_the_users_verbs_come_first_and_the_builders_apart():
    shown = groups(CliRunner().invoke(app, ["--help"]).stdout)
    assert list(shown)[1:] == ["Commands:", "About cameras and files:", "To build and measure rcdn:"]
    assert shown["Commands:"] == USERS
    assert {"convert", "compare", "report"} <= set(shown["About cameras and files:"])
    assert {"render", "train", "export", "bench", "evaluate"} <= set(shown["To build and measure rcdn:"])


def test_every_verb_has_one_whole_line_of_80_columns():
    lines = CliRunner().invoke(app, ["--help"]).stdout.partition("Commands:")[2].splitlines()
    verbs = [line for line in lines if re.match(r"  \w", line)]
    assert len(verbs) == len(app.registered_commands) + len(entry_points(group=VERBS))
    assert all(line.endswith(".") and not line.endswith("...") and len(line) <= 80 for line in verbs), verbs


def test_verbs_of_a_package_that_is_not_installed_say_which_it_is(monkeypatch):
    monkeypatch.setattr("importlib.metadata.entry_points", lambda **_: EntryPoints(()))
    for verb in ("evaluate", "bench"):
        done = CliRunner().invoke(app, [verb, "--help"])
        assert done.exit_code == 2
        assert done.stderr == f"error: rcdn {verb} is in another package: pip install rcdn-lab\n"
    assert not {"evaluate", "bench"} & {
        v for verbs in groups(CliRunner().invoke(app, ["--help"]).stdout).values() for v in verbs
    }


@pytest.mark.parametrize(("verb", "option"), [("calibrate", "--format"), ("convert", "--to")])
def test_formats_of_camera_files_are_in_the_help_and_others_are_refused(verb, option):
    text = " ".join(CliRunner().invoke(app, [verb, "--help"]).stdout.split())
    told = re.search(rf"{option} FORMAT (.*?\.) ", text)[1]
    assert all(re.search(rf"\b{name}\b", told) for name in names_of()), told
    done = CliRunner().invoke(app, [verb, "a", "b", option, "pdf"])
    assert done.exit_code == 2
    assert f"'pdf' is none of {', '.join(names_of())}" in done.stderr


# ---- completion


def rcdn(*arguments, **variables):
    """Standard output of `rcdn` in a process of its own."""
    command = [sys.executable, "-m", "rcdn", *arguments]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=120, env={**os.environ, **variables}
    )
    assert "Traceback" not in done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("rcdn und", ["undistort"]),
        ("rcdn detect --js", ["--json"]),
        ("rcdn undistort camera.yaml --ba", ["--balance"]),
        ("rcdn convert --to ro", ["ros"]),
        ("rcdn evaluate swe", ["sweep"]),
        ("rcdn nosuch", []),
    ],
)
def test_bash_is_given_verbs_options_and_values(words, wanted):
    out = rcdn(_RCDN_COMPLETE="complete_bash", COMP_WORDS=words, COMP_CWORD=str(len(words.split()) - 1))
    assert out.split() == wanted


def test_completion_is_installed_where_the_shell_looks(tmp_path):
    disabled = {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    out = rcdn("--install-completion", "bash", HOME=str(tmp_path), **disabled)
    assert "bash completion installed" in out
    assert "rcdn.sh" in (tmp_path / ".bashrc").read_text()
    (script,) = tmp_path.rglob("rcdn.sh")
    assert "_RCDN_COMPLETE=complete_bash" in script.read_text()
    for shell in ("zsh", "fish", "powershell"):
        assert "_RCDN_COMPLETE" in rcdn("--show-completion", shell, **disabled)
