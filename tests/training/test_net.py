"""Networks: the counts of Table 1, context, initial weights, the unpadded output."""

from __future__ import annotations

import pytest

pytest.importorskip("rcdn.training", exc_type=ImportError, reason="needs rcdn[train]")

import torch
from torch import nn

from rcdn.errors import ConfigError
from rcdn.training.net import ARCHITECTURES, Architecture, CornerNet, build, grow, parameter_count, without_norms

TABLE_1 = {  # name: parameters, multiply–adds a pixel, receptive field
    "A": (2929, 2904, 15),
    "B": (4041, 4000, 15),
    "C": (14681, 14624, 15),
    "D": (16641, 16560, 17),
    "D-3": (16897, 16816, 19),
    "E": (33217, 33088, 19),
    "E-16": (25889, 25776, 19),
    "F": (34273, 34112, 19),
    "G": (50657, 50496, 21),
    "H": (43521, 43328, 21),
}


@pytest.mark.parametrize("name", TABLE_1)
def test_counts_of_table_1(name):
    net = build(name)
    parameters, macs, field = TABLE_1[name]
    assert parameter_count(net) == parameters
    assert net.architecture.macs == macs
    assert net.architecture.margins == (field // 2, field // 2)
    assert net.architecture.cell == 1


def test_the_table_is_complete():
    assert set(ARCHITECTURES) == {*TABLE_1, "Q"}


def test_cell_network():
    net = build("Q")
    assert net.architecture.margins == (22, 23)
    assert net.architecture.macs == 25 * 16 / 4 + (9 * 16 * 32 + 5 * 9 * 32 * 32 + 32 * 16) / 16
    bias_free = sum(m.weight.numel() for m in net.modules() if isinstance(m, nn.Conv2d))
    assert bias_free == 25 * 16 + 9 * 16 * 32 + 5 * 9 * 32 * 32 + 32 * 16


@pytest.mark.parametrize("name", ["A", "F", "Q"])
def test_margins_are_the_pixels_that_one_output_cell_sees(name):
    """The gradient of a cell of the output reaches its margins' rim, and the input is no larger than that."""
    torch.manual_seed(1)
    net = build(name).eval()
    before, after = net.architecture.margins
    side = before + net.architecture.cell + after
    image = torch.rand(1, 1, side, side, requires_grad=True)
    out = net(image)
    assert out.shape == (1, net.architecture.cell, net.architecture.cell)
    for parameter in net.parameters():
        nn.init.uniform_(parameter, 0.01, 0.1)  # all positive: no ReLU hides a path
    net(image).sum().backward()
    assert (image.grad != 0).all()


@pytest.mark.parametrize("name", ["A", "F"])
def test_a_pixel_of_the_output_lies_at_its_pixel_of_the_input(name):
    net = build(name)
    before, _ = net.architecture.margins
    image = torch.zeros(1, 1, 60, 50, requires_grad=True)
    net(image)[0, 7, 11].backward()
    rows, cols = (image.grad[0, 0] != 0).nonzero().T
    assert rows.min() == 7
    assert rows.max() == 7 + 2 * before
    assert cols.min() == 11
    assert cols.max() == 11 + 2 * before


@pytest.mark.parametrize("name", ["A", "F"])
def test_xavier_weights_and_biases_of_a_tenth(name):
    torch.manual_seed(3)
    for module in build(name).modules():
        if isinstance(module, nn.Conv2d):
            k = module.kernel_size[0] ** 2
            bound = (6 / (k * (module.in_channels + module.out_channels))) ** 0.5
            assert module.weight.abs().max() <= bound
            if module.weight.numel() >= 1000:
                assert module.weight.abs().max() > 0.98 * bound
                assert abs(float(module.weight.detach().std()) / (bound / 3**0.5) - 1) < 0.05
            assert (module.bias == 0.1).all()


def test_the_cell_network_begins_with_no_corners():
    net = build("Q")
    assert (net.blocks[-1][0].bias == -5).all()
    assert all((block[0].bias == 0).all() for block in list(net.blocks)[:-1])


def test_no_activation_after_the_last_convolution():
    last = build("F").blocks[-1]
    assert [type(m) for m in last] == [nn.Conv2d]
    assert [type(m) for m in build("F").blocks[0]] == [nn.Conv2d, nn.ReLU]
    assert [type(m) for m in build("Q").blocks[0]] == [nn.Conv2d, nn.BatchNorm2d, nn.ReLU]


def test_cells_unfold_row_by_row():
    """Channel 4·y + x of an output position is pixel (x, y) of its block."""
    net = CornerNet(Architecture(((1, 16, 4),), cell=4))
    nn.init.zeros_(net.blocks[0][0].weight)
    with torch.no_grad():
        net.blocks[0][0].bias.copy_(torch.arange(16.0))
    assert net(torch.zeros(1, 1, 4, 4))[0].tolist() == torch.arange(16.0).reshape(4, 4).tolist()


def test_an_unknown_name_is_refused():
    with pytest.raises(ConfigError, match="architecture must be one of"):
        build("Z")


def test_any_network_can_have_a_batch_norm_for_its_training():
    net = build("A", batch_norm=True)
    assert [type(m) for m in net.blocks[0]] == [nn.Conv2d, nn.BatchNorm2d, nn.ReLU]
    assert float(net.blocks[-1][0].bias.detach()) == pytest.approx(0.1)
    assert net.architecture.margins == build("A").architecture.margins


@pytest.mark.parametrize(("student", "teacher"), [("B", "A"), ("F", "E")])
def test_a_grown_network_begins_as_its_teacher(student, teacher):
    """Without noise on the copies the response is the teacher's, exactly but for rounding."""
    torch.manual_seed(5)
    old, new = build(teacher), build(student)
    nn.init.constant_(old.blocks[-1][0].bias, 0.5)
    kept = grow(new, old, noise=0.0)
    image = torch.rand(2, 1, 40, 44)
    assert (old(image) > 0).any()
    assert torch.allclose(torch.relu(new(image)), torch.relu(old(image)), atol=1e-5)
    assert len(kept) == 2 * (len(old.blocks) - 1)
    own = {id(p) for p in new.parameters()} - {id(p) for p in kept}
    assert own == {id(p) for block in list(new.blocks)[-2:] for p in block.parameters()}


def test_copies_of_the_teachers_last_layer_differ_by_their_noise():
    torch.manual_seed(5)
    old, new = build("E"), build("F")
    grow(new, old)
    gap = new.blocks[-2][0].weight - old.blocks[-1][0].weight
    assert float(gap.detach().std()) == pytest.approx(0.01, rel=0.1)


def test_a_network_that_is_not_the_teacher_with_a_layer_more_is_refused():
    for student, teacher in (("F", "D"), ("A", "A"), ("B", "E")):
        with pytest.raises(ConfigError, match="teacher's layers"):
            grow(build(student), build(teacher))


def test_norms_fold_away():
    torch.manual_seed(6)
    net = build("E", batch_norm=True)
    for _ in range(3):
        net(torch.rand(4, 1, 30, 30) * 3)  # moves the running statistics
    for norm in net.modules():
        if isinstance(norm, nn.BatchNorm2d):
            nn.init.uniform_(norm.weight, 0.5, 2)
            nn.init.uniform_(norm.bias, -0.5, 0.5)
    plain = without_norms(net.eval())
    assert not any(isinstance(m, nn.BatchNorm2d) for m in plain.modules())
    image = torch.rand(1, 1, 40, 30)
    assert torch.allclose(plain(image), net(image), atol=1e-4)
