"""The stored 8-bit weights: what is read is what was tried, or nothing."""

import hashlib
import io
import json
import shutil

import numpy as np
import pytest

from rcdn.corners.cells import CellNetwork
from rcdn.corners.onnx_file import read_graph
from rcdn.corners.quantised import FORMS, read_npz, to_npz
from rcdn.corners.response import load_model
from rcdn.errors import RcdnError
from rcdn.synthetic import PRESETS, random_crop


@pytest.fixture(scope="module")
def auto():
    return load_model("auto")


def content(**changes):
    """A .npz file of zeros with some arrays changed or, if None, left out; and its checksum."""
    arrays = {key: np.zeros(length, kind) for key, (kind, length) in FORMS.items()} | changes
    out = io.BytesIO()
    np.savez(out, **{key: value for key, value in arrays.items() if value is not None})
    return out.getvalue(), hashlib.sha256(out.getvalue()).hexdigest()


def test_the_shipped_weights_are_those_of_the_shipped_network(auto):
    made = CellNetwork.of(read_graph(load_model("auto", stored=False).data), auto.facts["ranges"])
    assert (auto.cells.reals == made.reals).all()
    assert (auto.cells.whole == made.whole).all()
    assert hashlib.sha256(to_npz(made)).hexdigest() == auto.facts["quantised"]["sha256"]


def test_a_file_that_is_read_is_what_was_written(auto):
    data = to_npz(auto.cells)
    again = read_npz(data, hashlib.sha256(data).hexdigest(), "a.npz")
    assert again.reals.tobytes() == auto.cells.reals.tobytes()
    assert again.whole.tobytes() == auto.cells.whole.tobytes()
    assert to_npz(again) == data


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"reals": None}, "holds no 8-bit weights"),
        ({"reals": np.zeros(7, np.float32)}, r"'reals' must be float32 \(1344,\), not float32 \(7,\)"),
        ({"reals": np.zeros(1344)}, "not float64"),
        ({"whole": np.zeros((2, 25344), np.int8)}, "'whole' must be int8"),
        ({"whole": np.array([{}])}, "holds no 8-bit weights"),
        ({"reals": np.full(1344, np.nan, np.float32)}, "must be finite"),
    ],
)
def test_other_arrays_are_told(changes, message):
    with pytest.raises(RcdnError, match=message):
        read_npz(*content(**changes), "a.npz")


def test_other_bytes_are_told():
    data, checksum = content()
    for broken in (b"", b"garbage", data[:-9]):
        with pytest.raises(RcdnError, match=r"a\.npz is not the file .* export the network again"):
            read_npz(broken, checksum, "a.npz")
        with pytest.raises(RcdnError, match=r"a\.npz holds no 8-bit weights"):
            read_npz(broken, hashlib.sha256(broken).hexdigest(), "a.npz")


@pytest.fixture
def custom(tmp_path):
    """The shipped network as a user's own."""
    from importlib.resources import files

    for ending in ("onnx", "json", "npz"):
        shutil.copy(files("rcdn") / "weights" / f"rcdn_q.{ending}", tmp_path / f"own.{ending}")
    return tmp_path / "own.onnx"


def test_a_network_of_ones_own_runs_with_its_stored_weights(custom, auto):
    grey = random_crop(3, 120, PRESETS["ordinary"])[0]
    assert (load_model(str(custom))(grey, 1) == auto(grey, 1)).all()


def test_a_network_exported_before_weights_were_stored_runs_in_floating_point(custom):
    """Slower, and as it was trained: nothing that nobody has tried."""
    facts = json.loads(custom.with_suffix(".json").read_text())
    del facts["quantised"]
    custom.with_suffix(".json").write_text(json.dumps(facts))
    grey = random_crop(3, 120, PRESETS["ordinary"])[0]
    trained = load_model("auto", stored=False)
    assert (load_model(str(custom))(grey, 1) == trained(grey, 1)).all()


def test_stored_weights_that_are_gone_or_others_are_told(custom):
    custom.with_suffix(".npz").write_bytes(content()[0])
    with pytest.raises(RcdnError, match=r"own\.npz is not the file that the \.json beside it describes.*rcdn export"):
        load_model(str(custom))
    custom.with_suffix(".npz").unlink()
    with pytest.raises(RcdnError, match=r"no 8-bit weights beside .* export it again"):
        load_model(str(custom))


def test_a_word_about_stored_weights_that_makes_no_sense_is_told(custom):
    facts = json.loads(custom.with_suffix(".json").read_text())
    for word in (None, 3, [], {}, {"sha256": 7}):
        custom.with_suffix(".json").write_text(json.dumps(facts | {"quantised": word}))
        with pytest.raises(RcdnError, match=r"own\.npz is not the file"):
            load_model(str(custom))
