"""`rcdn detect --engine ray`: the same files as the local engine's, whatever dies on the way."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import pytest
from typer.testing import CliRunner

from detector_stand_in import BROKEN, KILL, KILL_ONCE, MARKS, picture, video
from rcdn.batch import ray
from rcdn.cli import app
from rcdn.errors import DependencyError
from rcdn.io import read_detections

with_ray = pytest.mark.skipif(find_spec("ray") is None, reason="Ray isn't installed: pip install 'rcdn[ray]'")
COMMAND = """
import detector_stand_in, sys
from rcdn.cli import app, detect
detect._make_detector = getattr(detector_stand_in, sys.argv[1])
if __name__ == "__main__":
    app(["detect", *sys.argv[2:]], prog_name="rcdn")
"""


def detect(folder, detector, *arguments):
    """The command in `folder` with a stand-in: its result, and how often each picture was looked at."""
    marks = folder.parent / f"marks{len(list(folder.parent.iterdir()))}"
    marks.mkdir()
    (folder.parent / "command.py").write_text(COMMAND)
    paths = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    environment = {k: v for k, v in os.environ.items() if not k.startswith("RAY_")} | {"PYTHONPATH": paths}
    done = subprocess.run(
        [sys.executable, "../command.py", detector, *arguments], cwd=folder, env=environment | {MARKS: str(marks)},
        text=True, capture_output=True, timeout=240, check=False,
    )  # fmt: skip
    return done, Counter(p.name.rsplit(" ", 2)[0] for p in marks.iterdir())


@with_ray
def test_a_killed_worker_loses_nothing_and_the_bytes_are_the_local_engine_s(tmp_path):
    home = tmp_path / "home"
    for k in range(20):
        cols = {4: BROKEN, 9: KILL_ONCE, 15: KILL}.get(k, 5)
        picture(home / f"in/{k:02d}.png", cols=cols, rows=6, missing=k)
    (home / "in/zero.png").write_bytes(b"")
    video(home / "in/clip.avi", [None] * 3)
    found = {}
    for engine in ("local", "ray"):
        options = ["--jobs", "2", "--engine", engine, "--json", f"{engine}.json", "--vnl", f"{engine}.vnl"]
        done, marks = detect(home, "StandIn", "in", "missing.png", *options)
        assert done.returncode == 1, done.stderr
        frames = [what for what in marks if not what.startswith(("5 6", f"{BROKEN} ", f"{KILL_ONCE} ", f"{KILL} "))]
        assert sum(marks[what] for what in frames) == 3
        once = {f"5 6 {k}": 1 for k in range(20) if k not in (4, 9, 15)}
        assert {what: n for what, n in marks.items() if what not in frames} == once | {
            f"{BROKEN} 6 4": 1, f"{KILL_ONCE} 6 9": 2, f"{KILL} 6 15": 2,
        }  # fmt: skip
        found[engine] = [
            (home / f"{engine}.json").read_bytes(), (home / f"{engine}.vnl").read_bytes(), done.stderr,
            done.stdout.splitlines()[:-1],  # but for the seconds
        ]  # fmt: skip
    assert found["ray"] == found["local"]
    images, errors = read_detections(home / "ray.json")
    assert len(images) == 18 + 3
    assert [name for name, _ in errors] == ["missing.png", "in/04.png", "in/15.png", "in/zero.png"]


def test_without_ray_the_error_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setattr(ray, "find_spec", lambda name: None)
    with pytest.raises(DependencyError, match=r"pip install 'rcdn\[ray\]'"):
        ray.check()
    result = CliRunner().invoke(app, ["detect", str(picture(tmp_path / "a.png")), "--engine", "ray"])
    assert (result.exit_code, result.stdout) == (1, "")
    assert result.stderr == "error: --engine ray needs Ray: pip install 'rcdn[ray]'\n"


LISTENING = """
import os, re
from rcdn.batch import ray

def listening():
    addresses = {}
    for family in ("tcp", "tcp6"):
        for line in open(f"/proc/net/{family}").read().splitlines()[1:]:
            part = line.split()
            if part[3] == "0A":
                addresses[part[9]] = part[1].rpartition(":")[0]
    for pid in filter(str.isdigit, os.listdir("/proc")):
        try:
            if os.getpid() in (int(pid), os.getpgid(int(pid))):
                links = [os.readlink(f"/proc/{pid}/fd/{fd}") for fd in os.listdir(f"/proc/{pid}/fd")]
                yield from (
                    addresses[m[1]]
                    for m in map(re.compile(r"socket:.(\\d+)").match, links)
                    if m and m[1] in addresses
                )
        except OSError:
            pass

def work():
    return 1

if __name__ == "__main__":
    os.setpgrp()
    with ray._cluster(ray.LOCAL, 1) as ray:
        ray.get(ray.remote(work).remote())
        found = sorted(set(listening()))
    print(*found)
"""


@with_ray
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_a_cluster_of_this_machine_listens_to_this_machine_only(tmp_path):
    (tmp_path / "listening.py").write_text(LISTENING)
    environment = {k: v for k, v in os.environ.items() if not k.startswith("RAY_")}
    command = [sys.executable, tmp_path / "listening.py"]
    done = subprocess.run(command, env=environment, text=True, capture_output=True, timeout=240, check=False)
    found = done.stdout.split()
    assert found, done.stderr
    assert set(found) <= {"0100007F", "0000000000000000FFFF00000100007F", "00000000000000000000000001000000"}


def test_the_loopback_is_asked_for_before_ray_is_imported(monkeypatch):
    for address, wanted in ((ray.LOCAL, "0"), ("10.0.0.1:1", None)):
        monkeypatch.delenv("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", raising=False)
        monkeypatch.setitem(sys.modules, "ray", None)
        with pytest.raises(ImportError), ray._cluster(address, 1):
            pass
        assert os.environ.pop("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", None) == wanted
