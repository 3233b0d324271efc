"""Reading ONNX files, against the package `onnx`, and files that are none."""

from contextlib import suppress
from importlib.resources import files

import numpy as np
import pytest

from rcdn.corners.onnx_file import read_graph
from rcdn.errors import RcdnError

WEIGHTS = files("rcdn") / "weights"
SHIPPED = ["rcdn_q", "rcdn_deltille", "rcdn_f"]


def tensor(name, shape, raw=True, seed=0, kind="FLOAT"):
    onnx = pytest.importorskip("onnx", reason="compares with the package onnx")
    values = np.random.default_rng(seed).normal(0, 3, shape).astype("f4")
    number = getattr(onnx.TensorProto, kind)
    if kind != "FLOAT":
        return onnx.helper.make_tensor(name, number, shape, values.astype("i8").ravel().tolist())
    return onnx.helper.make_tensor(name, number, shape, values.tobytes() if raw else values.ravel().tolist(), raw=raw)


def made(*tensors):
    """A network of three operations, one of which takes the tensors."""
    onnx = pytest.importorskip("onnx", reason="compares with the package onnx")
    make = onnx.helper
    names = [t.name for t in tensors]
    nodes = [
        make.make_node("Conv", ["image", *names], ["a"], kernel_shape=[3, 3], name="first"),
        make.make_node("Relu", ["a"], ["b"]),
        make.make_node("Clip", ["b", "", names[0]], ["c"]),
    ]
    ends = [make.make_tensor_value_info(n, onnx.TensorProto.FLOAT, [1, 1, "h", "w"]) for n in ("image", "c")]
    graph = make.make_graph(nodes, "graph", ends[:1], ends[1:], list(tensors), doc_string="what it is" * 50)
    return make.make_model(graph, producer_name="test")


def assert_same(data):
    """What we read is what `onnx` reads."""
    onnx = pytest.importorskip("onnx", reason="compares with the package onnx")
    graph, known = read_graph(data), onnx.load_from_string(data).graph
    assert graph.nodes == tuple(node.op_type for node in known.node)
    assert graph.inputs == tuple(tuple(node.input) for node in known.node)
    tensors = {
        t.name: onnx.numpy_helper.to_array(t) for t in known.initializer if t.data_type == onnx.TensorProto.FLOAT
    }
    assert graph.tensors.keys() == tensors.keys()
    for name, values in tensors.items():
        assert graph.tensors[name].dtype == np.float32
        assert graph.tensors[name].shape == values.shape
        assert (graph.tensors[name] == values).all()
    return graph


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_weights(name):
    graph = assert_same((WEIGHTS / f"{name}.onnx").read_bytes())
    assert sum(t.size for t in graph.tensors.values()) > 30_000


@pytest.mark.parametrize("raw", [True, False])
def test_tensors_as_bytes_and_as_numbers(raw):
    shapes = {"w": (4, 1, 3, 3), "b": (4,), "one": (), "long": (1000, 7), "none": (0, 3)}
    tensors = [tensor(name, shape, raw, k) for k, (name, shape) in enumerate(shapes.items())]
    graph = assert_same(made(*tensors).SerializeToString())
    assert {name: t.shape for name, t in graph.tensors.items()} == shapes
    assert graph.nodes == ("Conv", "Relu", "Clip")
    assert graph.inputs[2] == ("b", "", "w")


def test_other_types_are_left_out():
    data = made(tensor("w", (2, 2)), tensor("i", (5,), kind="INT64"), tensor("s", (3,), kind="INT8"))
    assert set(assert_same(data.SerializeToString()).tensors) == {"w"}


def number(value):
    out = b""
    while value > 127:
        out, value = out + bytes([value & 127 | 128]), value >> 7
    return out + bytes([value])


def field(key, content):
    return number(key << 3 | 2) + number(len(content)) + content


def test_numbers_one_by_one():
    """Older writers store each float, and each dimension, as a field by itself; and all of the latter together."""
    values = np.array([1.5, -2.0, 3.25], "<f4")
    alone = b"".join(number(4 << 3 | 5) + v.tobytes() for v in values)
    start = field(8, b"t") + number(2 << 3) + number(1)
    for dims in (number(1 << 3) + number(3), field(1, number(3))):
        graph = read_graph(field(7, field(5, start + dims + alone)))
        np.testing.assert_array_equal(graph.tensors["t"], values)


@pytest.mark.parametrize(
    "data",
    [
        b"", b"\0", b"hello", b"\xff" * 40, b"\x08" + b"\xff" * 9 + b"\x01", bytes(range(256)), b"{}" * 100,
        field(7, b"")[:-1] + b"\x05", field(1, b"no graph"), number(7 << 3) + number(2**60),
        field(7, number(1 << 3) + number(2**60)), field(7, field(1, b"")), field(7, field(1, field(4, b"\xff\xfe"))),
        field(7, field(5, number(8 << 3) + number(2**62))),
        field(7, field(5, number(2 << 3) + number(1) + number(1 << 3) + number(5) + field(9, b"1234"))),
        field(7, field(5, number(2 << 3) + number(1) + number(1 << 3) + number(2**64 - 1) + field(9, b"1234"))),
        field(7, field(5, number(2 << 3) + number(1) + field(9, b"123"))),
    ],
    ids=range(17),
)  # fmt: skip
def test_other_files_are_told(data):
    with pytest.raises(RcdnError, match="not an ONNX file"):
        read_graph(data)


@pytest.mark.parametrize("name", SHIPPED)
def test_broken_files_never_break_anything_else(name):
    """Cut off, or with bytes changed: another graph is read, or it is told."""
    data = (WEIGHTS / f"{name}.onnx").read_bytes()
    rng = np.random.default_rng(1)
    for _ in range(60):
        with pytest.raises(RcdnError, match="not an ONNX file"):
            read_graph(data[: rng.integers(20, len(data) - 20)])
    for _ in range(150):
        broken = bytearray(data)
        for at in (rng.random(4) ** 3 * len(data)).astype(int):
            broken[at] = rng.integers(256)
        with suppress(RcdnError):
            read_graph(bytes(broken))
