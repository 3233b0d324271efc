"""The compiled cell network against itself, piece by piece, and against ONNX Runtime."""

from types import SimpleNamespace

import numpy as np
import pytest

from rcdn.corners.cells import SHAPES, CellNetwork
from rcdn.corners.onnx_file import read_graph
from rcdn.corners.response import PROVIDERS, ResponseModel, load_model
from rcdn.corners.sieve import CELL, every_cell
from rcdn.errors import ConfigError, RcdnError
from rcdn.synthetic import PRESETS, random_crop


@pytest.fixture(scope="module", params=["rcdn_q"])
def model(request):
    return load_model(request.param)


@pytest.fixture(scope="module")
def auto():
    return load_model("auto")


@pytest.fixture(scope="module")
def trained():
    """The network before its weights had 8 bits: in the source distribution only."""
    return load_model("auto", stored=False)


def crop(seed, size=(149, 131), ranges="training"):
    return np.ascontiguousarray(random_crop(seed, max(size), PRESETS[ranges])[0][: size[0], : size[1]])


def own_crops(model, count):
    """Of what the network was made for, both kinds of pictures."""
    ranges = model.facts["training"]["pool"]["ranges"]
    for k in range(count):
        grey = crop(700 + k, ranges=ranges)
        yield grey
        yield (grey[:122, :95] * np.float32(0.9) + np.float32(3.3)).astype(np.float32)


def pixels_of(cells, shape):
    return np.kron(cells, np.ones((CELL, CELL), bool))[: shape[0], : shape[1]]


def masks(shape):
    """Many cells, few, one, a column, the last ones, none."""
    rng = np.random.default_rng(1)
    for share in (0.5, 0.02):
        yield rng.random(shape) < share
    empty = np.zeros(shape, bool)
    for at in [(shape[0] // 2, shape[1] // 2), (slice(None), 1), (-1, slice(None)), (slice(-3, None), slice(-3, None))]:
        one = empty.copy()
        one[at] = True
        yield one
    yield empty


def test_the_kernel_is_used(model):
    assert model.cells is not None
    grey = crop(1)
    assert (model(grey) == model.cells(grey, every_cell(grey))).all()


def test_marked_cells_are_as_if_all_were(model):
    """Bit for bit, and 0 elsewhere."""
    for grey in own_crops(model, 1):
        dense = model(grey, 1)
        for cells in masks(every_cell(grey).shape):
            sparse, seen = model(grey, 1, cells=cells), pixels_of(cells, grey.shape)
            assert sparse[seen].tobytes() == dense[seen].tobytes()
            assert not sparse[~seen].any()


def test_threads_change_nothing(auto):
    """The first heights leave one, two or three bands; cells on the seams between them."""
    for height in (63, 130, 200, 257):
        grey = crop(2, (height, 90))
        for cells in (every_cell(grey), np.random.default_rng(2).random(every_cell(grey).shape) < 0.3):
            one = auto(grey, 1, cells=cells)
            assert all(auto(grey, n, cells=cells).tobytes() == one.tobytes() for n in (0, 2, 3, 7))


def test_vector_instructions_change_nothing(model):
    network = model.cells
    for grey in own_crops(model, 2):
        known = network(grey, every_cell(grey), 1, 0)
        for instructions in (1, 2):
            assert network(grey, every_cell(grey), 1, instructions).tobytes() == known.tobytes()


@pytest.mark.parametrize("sign", ["+", "-", "both"])
def test_vector_instructions_hold_the_largest_sums(sign):
    """Weights of ±127 and inputs of 255, as large as they may be: nothing overflows in any form of the sums."""
    rng = np.random.default_rng(5)
    whole = {"+": np.full, "-": lambda n, v: np.full(n, -v), "both": lambda n, v: v * rng.choice([-1, 1], n)}[sign]
    largest = 9 * 32 * 255 * 127
    layers = [(np.full(32, 3 / largest * 255), np.full(32, 128.0)) for _ in range(6)]  # to 0..255, and beyond
    reals = [np.zeros(25 * 16), np.full(16, 300.0), *(a for pair in layers for a in pair)]
    reals += [np.full(16, 1e-4), np.zeros(16), rng.integers(-127, 128, 32 * 16)]
    weights = np.asarray(whole(9 * 16 * 32 + 5 * 9 * 32 * 32, 127), np.int8)
    network = CellNetwork(np.concatenate(reals).astype(np.float32), weights)
    grey = rng.integers(0, 256, (44, 300), np.uint8)
    cells = np.random.default_rng(1).random((11, 75)) < 0.3
    known = network(grey, cells, 1, 0)
    assert len(np.unique(known)) > 2
    for instructions in (1, 2):
        assert network(grey, cells, 1, instructions).tobytes() == known.tobytes()


@pytest.mark.parametrize("instructions", [0, 1, 2])
def test_an_argument_beyond_all_floats_is_a_response_of_0_or_1(instructions):
    reals = [np.zeros(26 * 16), *[np.ones(64)] * 6, np.full(16, 3e38), np.zeros(16)]
    last = np.tile([127.0, -127.0], (32, 8))
    network = CellNetwork(np.concatenate([*reals, last.ravel()]).astype(np.float32), np.ones(50688, np.int8))
    found = network(np.full((8, 8), 90, np.uint8), np.ones((2, 2), bool), 1, instructions)
    assert (found[:, ::2] == 1).all()
    assert (found[:, 1::2] < 1e-30).all()


@pytest.mark.parametrize("instructions", [0, 1])
def test_marked_cells_are_computed_alike_without_vector_instructions(auto, instructions):
    grey = crop(3)
    dense = auto.cells(grey, every_cell(grey), 1, instructions)
    cells = np.random.default_rng(3).random(every_cell(grey).shape) < 0.3
    seen = pixels_of(cells, grey.shape)
    sparse = auto.cells(grey, cells, 1, instructions)
    assert (sparse[seen] == dense[seen]).all()
    assert not sparse[~seen].any()


def test_whole_numbers_answer_as_the_network_does(model, trained):
    gaps = []
    for grey in own_crops(model, 6):
        ours, known = model(grey, 1), trained.by_onnx_runtime(grey, 1)
        assert np.abs(ours - known).max() < 0.05
        gaps.append(np.abs(ours - known)[known > 0.3])
    gaps = np.concatenate(gaps)
    assert len(gaps) > 300
    assert gaps.mean() < 0.006


@pytest.mark.parametrize("size", [(1, 1), (1, 90), (90, 1), (2, 2), (5, 9), (3, 200), (23, 24), (26, 45), (47, 4)])
@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_tiny_pictures(auto, size, kind):
    """Smaller than what the network sees around a cell: reflected again and again, as ONNX Runtime's is."""
    rng = np.random.default_rng(4)
    for grey in (crop(5)[: size[0], : size[1]], rng.integers(0, 256, size)):
        grey = np.resize(grey, size).astype(kind)
        ours = auto(grey, 2)
        assert (ours.shape, ours.dtype) == (size, np.float32)
        tall = np.repeat(grey, 50 if size[0] == 1 else 1, axis=0)  # a lone row or column is its own reflection
        wide = np.repeat(tall, 50 if size[1] == 1 else 1, axis=1)
        assert np.abs(ours - auto.by_onnx_runtime(wide, 1)[: size[0], : size[1]]).max() < 0.05


def test_bytes_and_floats_are_alike(model):
    for grey in list(own_crops(model, 2))[::2]:
        assert np.abs(model(grey, 1) - model(grey.astype(np.float32), 1)).max() < 0.01


def test_other_layouts_of_memory_are_alike(auto):
    grey, known = crop(6), auto(crop(6), 1)
    assert (auto(np.asfortranarray(grey), 1) == known).all()
    assert (auto(np.repeat(grey, 2, axis=1)[:, ::2], 1) == known).all()
    cells = np.random.default_rng(5).random(every_cell(grey).shape) < 0.3
    assert (auto(grey, 1, cells=np.asfortranarray(cells)) == auto(grey, 1, cells=cells)).all()


def test_the_response_moves_with_the_picture(auto):
    """A part that begins at a cell answers as the whole does, away from its rim."""
    grey = crop(7, (160, 144))
    part = auto(np.ascontiguousarray(grey[8:, 12:]), 1)
    assert (part[40:-40, 40:-40] == auto(grey, 1)[48:-40, 52:-40]).all()


def test_flat_pictures_have_no_response(auto):
    for level in (0, 100, 255):
        assert auto(np.full((60, 70), level, np.uint8), 1).max() < 0.05


def test_cells_of_another_shape_are_refused(auto):
    with pytest.raises(RcdnError, match="cells must have shape"):
        auto(crop(8), 1, cells=np.ones((5, 5), bool))


def without(model, **facts):
    return ResponseModel(model.onnx, model.normalisation, model.margins, model.cell, model.facts | facts)


def test_a_network_without_stored_weights_is_left_to_onnx_runtime(auto):
    plain, grey = without(auto), crop(9)
    assert plain.cells is None
    assert plain.cells_of(grey) is None
    assert (plain(grey, 1) == auto.by_onnx_runtime(grey, 1)).all()
    # the mask means nothing to it
    assert (plain(grey, 1, cells=np.zeros(every_cell(grey).shape, bool)) == plain(grey, 1)).all()


def test_a_network_of_another_shape_is_left_to_onnx_runtime():
    paper, grey = load_model("paper"), crop(10, (60, 50))
    assert paper.cells is None
    assert without(paper, ranges=[[1.0] * 32] * 5).cells is None
    assert CellNetwork.of(read_graph(paper.data), [[1.0]]) is None
    assert (paper(grey, 1) == paper.by_onnx_runtime(grey, 1)).all()


def test_shapes_are_those_of_the_shipped_networks(model):
    graph = read_graph(model.onnx)
    assert CellNetwork.fits(graph)
    weights = [
        graph.tensors[names[1]].shape for name, names in zip(graph.nodes, graph.inputs, strict=True) if name == "Conv"
    ]
    assert tuple(weights) == SHAPES


def test_wider_ranges_are_coarser(auto):
    """The ranges are used: with tenfold ones whole numbers are ten times as coarse, and yet it is the same network."""
    wide = CellNetwork.of(read_graph(auto.onnx), [[10 * v for v in values] for values in auto.facts["ranges"]])
    grey = crop(11)
    known, cells = auto.by_onnx_runtime(grey, 1), every_cell(grey)
    near, far = (np.abs(network(grey, cells, 1) - known)[known > 0.3].mean() for network in (auto.cells, wide))
    assert near < far < 0.3


@pytest.fixture
def as_if(monkeypatch):
    """ONNX Runtime as if it had these providers."""
    import onnxruntime as ort

    return lambda *names: monkeypatch.setattr(ort, "get_available_providers", lambda: list(names))


def test_a_gpu_that_is_not_there_is_told(as_if):
    as_if("CPUExecutionProvider")
    with pytest.raises(ConfigError, match="onnxruntime-gpu"):
        load_model("auto", device="cuda")
    assert load_model("auto", device="auto").device == load_model("auto", device="cpu").device == "cpu"


def test_a_gpu_that_is_there_is_taken(as_if):
    as_if("CUDAExecutionProvider", "CPUExecutionProvider")
    for wanted in ("cuda", "auto"):
        model = load_model("auto", device=wanted)
        assert model.device == "cuda"
        assert model.cells is None
        assert model.cells_of(crop(12)) is None
    assert load_model("auto", device="cpu").device == "cpu"


@pytest.mark.parametrize(
    ("name", "size", "tile", "batches"),
    [
        ("rcdn_q", (149, 131), 32, [16, 4, 4, 1]),
        ("rcdn_q", (149, 131), 16, [16] * 4 + [8, 8, 9, 1]),
        ("rcdn_f", (70, 59), 32, [2, 2, 1, 1]),
    ],
)
def test_tiles_that_go_together_give_what_single_ones_give(monkeypatch, name, size, tile, batches):
    """A GPU as it would be: at most 16 tiles of one shape go together: whole ones, those at the right,
    at the lower border, the last."""
    monkeypatch.setitem(PROVIDERS, "cuda", "CPUExecutionProvider")
    alone, together = load_model(name), load_model(name, device="cuda")
    assert together.session.get_providers() == ["CPUExecutionProvider"]
    run, inputs, sizes = together.session.run, together.session.get_inputs, []

    def spy(names, given):
        sizes.append(len(given["image"]))
        return run(names, given)

    monkeypatch.setitem(together.__dict__, "session", SimpleNamespace(run=spy, get_inputs=inputs))
    grey = crop(13, size)
    np.testing.assert_allclose(together(grey, 2, tile=tile), alone.by_onnx_runtime(grey, 1, tile=tile), atol=1e-6)
    assert sorted(sizes) == sorted(batches)
