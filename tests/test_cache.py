"""The cache of detections: exact, safe against damage, kept apart by all that determines a result, bounded."""

from __future__ import annotations

import importlib.metadata
import os
import shutil
import subprocess
import sys
import time
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import rcdn
from rcdn.batch import cache as _cache
from rcdn.batch.cache import Cache, default_folder, fingerprint, open_cache
from rcdn.config import DetectorConfig
from rcdn.errors import OutputError
from rcdn.io import ImageResult
from rcdn.types import Board, Corners


def result(name="a.png", seed=0):
    """Detections with numbers that no short decimal holds, unknown ones among them."""
    rng = np.random.default_rng(seed)
    ij = np.array([(i, j) for j in range(3) for i in range(4)])
    sigma = rng.random(12) / 7
    sigma[3] = np.nan
    board = Board(rng.random((12, 2)) * 99, ij, (640, 480), rng.random(12), np.arange(12) % 4, "ambiguous_180", sigma)
    corners = Corners(board.xy, board.response, board.status, axes=rng.random((12, 2)), sigma=sigma)
    return ImageResult(name, 640, 480, corners, (board, board))


def assert_equal(a, b):
    """Bit for bit, types and all."""
    assert (a.path, a.width, a.height, len(a.boards)) == (b.path, b.width, b.height, len(b.boards))
    for one, other in zip((a.corners, *a.boards), (b.corners, *b.boards), strict=True):
        for name in (f.name for f in fields(one)):
            left, right = getattr(one, name), getattr(other, name)
            assert type(left) is type(right), name
            if isinstance(left, np.ndarray):
                assert left.dtype == right.dtype
                assert not right.flags.writeable
            np.testing.assert_array_equal(left, right, err_msg=name)


@pytest.fixture
def cache(tmp_path):
    return Cache(tmp_path / "cache", "salt")


def entries(cache):
    return sorted(cache.folder.rglob("*.json"))


def test_every_number_comes_back_exactly_under_a_new_name(cache):
    key = cache.key("content")
    assert cache.result(key, "b.png") is None
    cache.keep(key, result())
    assert_equal(cache.result(key, "b.png"), result("b.png"))


def test_no_corners_and_no_sigma_come_back_as_that(cache):
    empty = ImageResult("a", 5, 4, Corners(np.zeros((0, 2)), [], []), ())
    cache.keep("00", empty)
    assert_equal(cache.result("00", "a"), empty)


def test_warnings_come_back(cache):
    kept = ImageResult("a", 5, 4, Corners(np.zeros((0, 2)), [], []), (), ("one", "two"))
    cache.keep("00", kept)
    assert cache.result("00", "a").warnings == ("one", "two")


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: b"",
        lambda data: data[: len(data) // 2],
        lambda data: data.replace(b"0.1", b"0.2", 1),
        lambda data: b"not hex\n{}",
        lambda data: b"\xff\xfe",
        lambda data: b"2144df1c\n" + b"[" * 3,
    ],
)
def test_damaged_entries_are_not_there_and_are_written_again(cache, damage):
    key = cache.key("content")
    cache.keep(key, result())
    (path,) = entries(cache)
    path.write_bytes(damage(path.read_bytes()))
    assert cache.result(key, "a.png") is None
    cache.keep(key, result())
    assert_equal(cache.result(key, "a.png"), result())


def test_entries_that_changed_places_are_not_believed(cache):
    keys = [cache.key("one"), cache.key("two")]
    for seed, key in enumerate(keys):
        cache.keep(key, result(seed=seed))
    one, two = (next(p for p in entries(cache) if p.stem == key) for key in keys)
    content = one.read_bytes()
    one.write_bytes(two.read_bytes())
    two.write_bytes(content)
    assert [cache.result(key, "a.png") for key in keys] == [None, None]


@pytest.mark.parametrize(
    ("where", "value"),
    [
        (("corners", "status", 0), 999_999), (("corners", "status", 0), 7), (("corners", "status", 0), 1.5),
        (("boards", 0, "status", 0), -1), (("boards", 0, "status", 0), 10**400), (("boards", 0, "xy", 3, 0), 1e150),
        (("boards", 0, "xy", 3, 0), float("nan")), (("boards", 0, "xy", 3), [1.0]), (("boards", 0, "ij", 2, 1), 10**18),
        (("boards", 0, "ij", 2, 1), -4), (("boards", 0, "ij", 2, 1), 0.5), (("boards", 0, "orientation"), "upright"),
        (("boards", 0, "orientation"), []), (("boards", 0, "pattern"), 5), (("boards", 0, "image_size"), [640, -480]),
        (("boards", 0, "image_size"), [1, 2, 3]), (("boards", 0, "sigma", 1), "a"), (("corners", "axes"), [[1.0]]),
        (("width",), -5), (("width",), 10**400), (("width",), True), (("corners",), []), (("boards",), "ab"),
    ],
)  # fmt: skip
def test_values_that_no_detection_has_are_not_there(cache, where, value):
    key = cache.key("content")
    cache.keep(key, result())
    record = cache.get(key)
    part = record
    for step in where[:-1]:
        part = part[step]
    part[where[-1]] = value
    cache.put(key, record)
    assert cache.get(key) is not None
    assert cache.result(key, "a.png") is None


@pytest.mark.parametrize("value", [{}, [], 3, {"boards": 1}, {"corners": {"xy": 1}, "boards": []}])
def test_entries_of_another_form_are_not_there(cache, value):
    cache.put("00", value)
    assert cache.get("00") == value
    assert cache.result("00", "a") is None


def test_keys_tell_contents_parts_and_salts_apart(cache):
    keys = [
        cache.key("a"),
        cache.key("b"),
        cache.key("a", "frame 1"),
        cache.key("a", "frame 12"),
        Cache(cache.folder, "other").key("a"),
    ]
    assert len(set(keys)) == len(keys)
    assert cache.key("a", "frame 1") == keys[2]


# ---- what determines a result


@pytest.fixture
def package(tmp_path):
    """A copy of the package's sources, to be edited."""
    home = Path(rcdn.__file__).parent
    return shutil.copytree(home, tmp_path / "rcdn", ignore=shutil.ignore_patterns("__pycache__", "weights"))


def test_settings_change_the_fingerprint_but_threads_do_not():
    auto = fingerprint(DetectorConfig())
    assert fingerprint(DetectorConfig(threads=3)) == auto
    others = [DetectorConfig(border=4.0), DetectorConfig(model="paper"), DetectorConfig.paper()]
    assert len({auto, *map(fingerprint, others)}) == 4


def test_weights_change_the_fingerprint(tmp_path):
    import hashlib
    import json

    home = Path(rcdn.__file__).parent / "weights"
    (tmp_path / "m.npz").write_bytes((home / "rcdn_q.npz").read_bytes())
    facts = json.loads((home / "rcdn_q.json").read_text())
    data = (home / "rcdn_q.onnx").read_bytes()
    config = DetectorConfig(model=str(tmp_path / "m.onnx"))

    def written(content):
        (tmp_path / "m.onnx").write_bytes(content)
        (tmp_path / "m.json").write_text(json.dumps(facts | {"sha256": hashlib.sha256(content).hexdigest()}))
        return fingerprint(config)

    first = written(data)
    assert written(data) == first
    assert written(data + b"\0") != first


def test_the_weights_that_run_are_in_the_fingerprint(monkeypatch):
    from rcdn.corners import response

    loaded, load = [], response.load_model
    monkeypatch.setattr(response, "load_model", lambda name: loaded.append(name) or load(name))
    for pattern in ("checker", "deltille"):
        fingerprint(DetectorConfig(pattern=pattern))
    assert loaded == ["auto", "rcdn_deltille"]


def test_another_library_of_kernels_changes_the_fingerprint(package):
    before = fingerprint(DetectorConfig(), package)
    (library,) = package.glob("_native.*")
    library.write_bytes(library.read_bytes() + b"\0")
    assert fingerprint(DetectorConfig(), package) != before


def test_the_fingerprint_does_not_import_onnx_runtime():
    code = (
        "import sys; from rcdn.batch.cache import fingerprint; from rcdn.config import DetectorConfig; "
        "fingerprint(DetectorConfig())"
    )
    out = subprocess.run(
        [sys.executable, "-c", f"{code}; print('onnxruntime' in sys.modules)"], capture_output=True, text=True
    )
    assert out.stdout == "False\n"


def test_the_version_of_onnx_runtime_changes_the_fingerprint(monkeypatch):
    before = fingerprint(DetectorConfig())
    real = importlib.metadata.version
    monkeypatch.setattr(importlib.metadata, "version", lambda name: "0.0" if name == "onnxruntime" else real(name))
    assert fingerprint(DetectorConfig()) != before


def test_detection_loads_nothing_that_the_fingerprint_leaves_out():
    """What detection loads is in the fingerprint, and each name that is left out is a part of the package."""
    code = (
        "import sys, numpy as np, rcdn\n"
        "squares = np.kron(np.indices((9, 12)).sum(0) % 2, np.ones((40, 40)))\n"
        "assert rcdn.Detector().detect(np.uint8(60 + 120 * np.pad(squares, 60, constant_values=1))).boards\n"
        "print(*(n for n in sys.modules if n.startswith('rcdn.')))"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "rcdn.detector" in loaded
    parts = {name.split(".")[1] for name in loaded}
    assert not parts & {Path(part).stem for part in _cache.NOT_DETECTION}
    assert all((Path(rcdn.__file__).parent / part).exists() for part in _cache.NOT_DETECTION)


@pytest.mark.parametrize(("source", "counts"), [("boards/grow.py", True), ("types/corners.py", True), ("new.py", True),
                                                ("cli/detect.py", False), ("report/overlay.py", False),
                                                ("terminal/options.py", False)])  # fmt: skip
def test_edits_of_the_detector_change_the_fingerprint_and_others_do_not(package, source, counts):
    before = fingerprint(DetectorConfig(), package)
    assert before == fingerprint(DetectorConfig())
    with open(package / source, "a") as file:
        file.write("# edited\n")
    assert (fingerprint(DetectorConfig(), package) != before) is counts


# ---- the folder


def test_the_usual_place(monkeypatch, tmp_path):
    monkeypatch.setattr(_cache.sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert default_folder() == tmp_path / "rcdn"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert default_folder() == tmp_path / ".cache" / "rcdn"
    monkeypatch.setattr(_cache.sys, "platform", "darwin")
    assert default_folder() == tmp_path / "Library" / "Caches" / "rcdn"


def test_open_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "usual"))
    config = DetectorConfig()
    assert open_cache(config, off=True) is None
    assert open_cache(config).folder == default_folder()
    assert open_cache(config, tmp_path / "mine").folder == tmp_path / "mine"
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="--cache"):
        open_cache(config, tmp_path / "file" / "inside")
    with pytest.raises(OutputError, match="--cache"):
        open_cache(config, tmp_path / "file")


def test_a_user_without_a_home_folder_has_no_cache(monkeypatch, capsys):
    def nobody(_):
        raise KeyError("uid not found")

    for name in ("XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("pwd.getpwuid", nobody)
    assert open_cache(DetectorConfig()) is None
    assert capsys.readouterr().err.splitlines() == [
        "note: this user has no home folder; what is found is kept for the next run only with --cache DIR"
    ]


def test_a_place_that_takes_nothing_spoils_nothing(tmp_path):
    (tmp_path / "file").write_text("")
    cache = Cache(tmp_path / "file", "salt")
    cache.keep("00", result())
    assert cache.result("00", "a") is None
    cache.prune()


def test_prune_deletes_what_nobody_used_for_longest(cache):
    keys = [cache.key(str(k)) for k in range(6)]
    for age, key in enumerate(keys):
        cache.keep(key, result())
        path = next(p for p in entries(cache) if p.stem == key)
        os.utime(path, (0, 1_000_000 - age))
    cache.result(keys[5], "a")  # used just now
    size = entries(cache)[0].stat().st_size
    mine = cache.folder / "mine.json"
    mine.write_text("not an entry")
    stale, fresh = (cache.folder / "detections" / "ab" / f".{name}.tmp" for name in ("stale", "fresh"))
    stale.parent.mkdir(exist_ok=True)
    stale.touch(), fresh.touch()
    os.utime(stale, (0, time.time() - 2 * _cache.STALE))
    cache.prune(3 * size)
    assert {p.stem for p in entries(cache)} == {keys[0], keys[1], keys[5], "mine"}
    assert (stale.exists(), fresh.exists()) == (False, True)
