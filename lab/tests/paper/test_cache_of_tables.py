"""The cache of Tables 2 and 3: what is known isn't computed again, and nothing is mixed."""

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from rcdn.errors import ConfigError
from rcdn_lab.paper import cache, tables
from rcdn_lab.paper.networks import NETWORKS
from rcdn_lab.paper.sets import SETS, shots


@pytest.fixture
def what(monkeypatch):
    """Table 2 on two small pictures, with weights for both networks."""
    for row in ("A", "MATE"):
        monkeypatch.setitem(NETWORKS, row, replace(NETWORKS[row], model="paper"))
    return tables.plan("table2", sets=["mesa-like"], most=2)


class Counter:
    """Networks that answer with a plain bump, and how often they were asked; `last`: when they are killed."""

    def __init__(self, last=99):
        self.requested, self.last = [], last

    def __call__(self, row):
        def respond(image):
            if len(self.requested) == self.last:
                raise KeyboardInterrupt
            self.requested.append(row)
            out = np.zeros(image.shape, np.float32)
            out[50:53, 60:63] = 1
            out[51, 61] = 2
            return out

        return respond


def test_a_second_run_computes_nothing_and_says_the_same(what, tmp_path):
    first, second = Counter(), Counter()
    one = tables.table(what, cache=tmp_path, load=first)
    two = tables.table(what, cache=tmp_path, load=second)
    assert one == two == tables.table(what, load=Counter())
    assert sorted(first.requested) == ["A", "A", "MATE", "MATE"]
    assert second.requested == []


def test_a_run_that_was_killed_goes_on(what, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        tables.table(what, cache=tmp_path, load=Counter(last=3))
    rest = Counter()
    assert tables.table(what, cache=tmp_path, load=rest) == tables.table(what, load=Counter())
    assert rest.requested == ["MATE"]


def test_more_pictures_and_other_tables_share_what_is_known(what, tmp_path, monkeypatch):
    tables.table(what, cache=tmp_path, load=Counter())
    for row in NETWORKS:
        monkeypatch.setitem(NETWORKS, row, replace(NETWORKS[row], model="paper"))
    more = Counter()
    tables.table(tables.plan("table3", sets=["mesa-like"], most=3), cache=tmp_path, load=more)
    assert more.requested.count("A") == more.requested.count("MATE") == 1
    assert more.requested.count("F") == 3


def test_other_weights_are_refused_by_name(what, tmp_path, monkeypatch):
    tables.table(what, cache=tmp_path, load=Counter())
    monkeypatch.setitem(NETWORKS, "MATE", replace(NETWORKS["MATE"], model="auto"))
    none = Counter()
    with pytest.raises(ConfigError, match=r"weights of MATE \(\w+ there, \w+ now\).*delete"):
        tables.table(what, cache=tmp_path, load=none)
    assert none.requested == []


def test_another_configuration_is_refused_and_all_that_differs_is_named(what, tmp_path, monkeypatch):
    tables.table(what, cache=tmp_path, load=Counter())
    facts = cache.configuration()
    changed = facts | {"version of numpy": "0.1", "source of corners": "f" * 64}
    monkeypatch.setattr(cache, "configuration", lambda: changed)
    with pytest.raises(ConfigError) as error:
        tables.table(what, cache=tmp_path, load=Counter())
    assert "version of numpy" in str(error.value)
    assert "source of corners" in str(error.value)
    assert "machine" not in str(error.value)


def test_the_configuration_covers_renderer_detector_and_libraries():
    facts = cache.configuration()
    for part in (
        "synthetic",
        "corners",
        "config.py",
        "io",
        "native.py",
        "rcdn_lab/paper/sets.py",
        "rcdn_lab/paper/score.py",
    ):
        assert len(facts[f"source of {part}"]) == 64
    assert {"version of onnxruntime", "version of numpy", "version of simplejpeg", "machine"} <= facts.keys()


def test_other_compiled_kernels_are_another_configuration(tmp_path, monkeypatch):
    native = import_module("rcdn._native")
    library, before = Path(native.__file__), cache.configuration()
    other = tmp_path / library.name
    other.write_bytes(library.read_bytes() + b"\0")
    monkeypatch.setattr(native, "__file__", str(other))
    after = cache.configuration()
    assert {key for key in before if before[key] != after[key]} == {"compiled kernels"}


def test_a_source_that_changes_has_another_checksum(tmp_path):
    (tmp_path / "a.py").write_text("1")
    before = cache.digest(tmp_path)
    (tmp_path / "a.py").write_text("2")
    assert cache.digest(tmp_path) != before
    (tmp_path / "a.py").write_text("1")
    assert cache.digest(tmp_path) == before
    (tmp_path / "b.py").write_text("")
    assert cache.digest(tmp_path) != before


def test_folders_of_others_are_left_alone(what, tmp_path):
    (tmp_path / "letter.txt").write_text("mine")
    with pytest.raises(ConfigError, match="something else"):
        tables.table(what, cache=tmp_path, load=Counter())
    assert [p.name for p in tmp_path.iterdir()] == ["letter.txt"]


def test_damaged_entries_are_computed_again(what, tmp_path):
    tables.table(what, cache=tmp_path, load=Counter())
    entry = next((tmp_path / "A").glob("mesa-like--*.json"))
    entry.write_text(entry.read_text()[:30])
    again = Counter()
    assert tables.table(what, cache=tmp_path, load=again) == tables.table(what, load=Counter())
    assert again.requested == ["A"]


def test_a_picture_that_changed_under_its_name_is_another(tmp_path):
    kept = cache.open_cache(tmp_path, {"A": "1"})
    (shot,) = shots(SETS["mesa-like"], most=1)
    kept.put("A", shot, {"rule": np.array([(3, 4)])})
    kept.put("A", shot, {"other": np.zeros((0, 2), int)})
    np.testing.assert_array_equal(kept.get("A", shot, "rule"), [(3, 4)])
    assert kept.get("A", shot, "other").shape == (0, 2)
    assert kept.get("A", shot, "unknown") is None
    other = replace(shot, identity="another")
    assert kept.get("A", other, "rule") is None
    kept.put("A", other, {"other": np.array([(5, 6)])})
    assert kept.get("A", other, "rule") is None
