"""Training data: labels, masks, symmetries, batches that can be made again, a pool that goes on."""

from __future__ import annotations

import hashlib
import itertools

import pytest

pytest.importorskip("rcdn.training", exc_type=ImportError, reason="needs rcdn[train]")

import cv2
import numpy as np
import torch

from rcdn.errors import ConfigError
from rcdn.synthetic import PRESETS, random_crop
from rcdn.training import samples
from rcdn.training.net import ARCHITECTURES
from rcdn.training.samples import Batches, Pool, PoolConfig, cut, draw, make_pool, pool_folder, targets, windows

SMALL = PoolConfig(count=5, size=48, ranges="hard", seed=2)


def batch(pool, arch, side, size, kind, ring, seed):
    return cut(pool, windows(len(pool), pool.images.shape[1] - side, size, kind, seed), arch, side, kind, ring)


def labelled(*rows):
    return [np.array(rows, float).reshape(-1, 3)]


def positives(goal):
    return [(int(x), int(y)) for y, x in zip(*np.nonzero(goal.positive[0].numpy()), strict=True)]


@pytest.mark.parametrize(
    ("xy", "pixel"),
    [((5, 7), (5, 7)), ((5.49, 7.2), (5, 7)), ((5.5, 7.5), (6, 8)), ((4.5, 6.5), (5, 7)), ((-0.5, 0.4), (0, 0))],
)
def test_a_corner_is_one_pixel_ties_go_up(xy, pixel):
    assert positives(targets(labelled((*xy, 1)), (12, 14), ring=False)) == [pixel]


def test_corners_outside_the_map_are_left_out():
    goal = targets(labelled((-0.6, 3, 1), (13.5, 3, 1), (3, 11.5, 1), (13.4, 11.4, 1)), (12, 14), ring=True)
    assert positives(goal) == [(13, 11)]


def test_ring_is_the_eight_neighbours():
    goal = targets(labelled((5.2, 6.9, 1)), (12, 14), ring=True)
    expected = np.ones((12, 14))
    expected[6:9, 4:7] = 0
    expected[7, 5] = 1
    assert np.array_equal(goal.weight[0], expected)
    assert (targets(labelled((5.2, 6.9, 1)), (12, 14), ring=False).weight == 1).all()


def test_a_neighbour_that_is_a_corner_itself_counts():
    goal = targets(labelled((5, 5, 1), (6, 5, 1)), (12, 14), ring=True)
    assert goal.weight[0, 5, 5] == goal.weight[0, 5, 6] == 1
    assert positives(goal) == [(5, 5), (6, 5)]


@pytest.mark.parametrize("ring", [True, False])
def test_doubtful_corners_blind_a_disc_of_four_pixels(ring):
    x, y = 8.4, 7.7
    goal = targets(labelled((x, y, 0)), (18, 18), ring)
    gy, gx = np.mgrid[:18, :18]
    assert np.array_equal(goal.weight[0] == 0, np.hypot(gx - x, gy - y) < 4)
    assert not goal.positive.any()
    assert (goal.heat == 0).all()


def test_a_sure_corner_beside_a_doubtful_one_is_still_demanded():
    goal = targets(labelled((8, 8, 0), (10, 8, 1)), (18, 18), ring=False)
    assert positives(goal) == [(10, 8)]
    assert goal.weight[0, 8, 10] == 1


def test_heat_is_a_gaussian_at_the_exact_corner():
    goal = targets(labelled((6.3, 5.8, 1), (8.0, 5.8, 1)), (12, 14), ring=False)
    gy, gx = np.mgrid[:12, :14]
    near = [np.exp(-((gx - x) ** 2 + (gy - 5.8) ** 2) / 2) for x in (6.3, 8.0)]
    assert np.abs(goal.heat[0].numpy() - np.maximum(*near)).max() < np.exp(-(3.5**2) / 2)  # cut off beyond 4 px
    assert goal.heat[0, 6, 6] == pytest.approx(np.exp(-(0.3**2 + 0.2**2) / 2))


def test_symmetries_keep_labels_on_their_corners():
    """A bright (or, in the negative, dark) pixel sits at each label, whatever is done to the picture."""
    image = np.full((30, 30), 100, np.uint8)
    labels = np.array([[3.0, 17.0, 1], [25.0, 9.0, 0]], np.float32)
    image[17, 3], image[9, 25] = 200, 220
    seen = set()
    for turn in itertools.product([False, True], repeat=4):
        turned, moved = samples._turned(image, labels, turn)
        (x0, y0, sure), (x1, y1, doubtful) = moved
        values = int(turned[int(y0), int(x0)]), int(turned[int(y1), int(x1)])
        assert values in ((200, 220), (55, 35))
        assert (sure, doubtful) == (1, 0)
        seen.add((x0, y0, values))
    assert len(seen) == 16  # eight symmetries, each as positive and negative


def test_a_window_carries_its_labels_along():
    """Minmax is linear: the brightest pixel of a window lies at its label."""
    image = np.random.default_rng(0).integers(100, 120, (40, 40)).astype(np.uint8)
    image[20, 19] = 255  # inside every window of 30 px
    labels = np.full((1, 512, 3), np.nan, np.float32)
    labels[0, 0] = 19, 20, 1
    pool = Pool(image[None], labels)
    chosen = windows(1, 10, 50, "minmax", (1,))
    for k in range(50):
        grey, (label,) = draw(pool, chosen, k, 30, "minmax")
        assert grey.shape == (30, 30)
        assert grey.dtype == np.float32
        y, x = np.unravel_index(int(np.abs(grey - np.median(grey)).argmax()), grey.shape)
        assert (x, y) == tuple(label[:2])


@pytest.fixture(scope="module")
def pool(tmp_path_factory):
    return make_pool(SMALL, tmp_path_factory.mktemp("pool"), workers=1)


def test_a_pool_is_random_crops_in_order(pool):
    assert pool.images.shape == (5, 48, 48)
    image, labels = random_crop(200_000_003, 48, PRESETS["hard"])
    assert np.array_equal(pool.images[3], image)
    kept = pool.labels[3][np.isfinite(pool.labels[3][:, 0])]
    assert np.array_equal(kept, labels.astype(np.float32))


@pytest.mark.parametrize(("name", "kind"), [("A", "minmax"), ("Q", "local")])
def test_a_batch_is_a_function_of_its_arguments(pool, name, kind):
    arch = ARCHITECTURES[name]
    side = sum(arch.margins) + 2
    if name == "Q":  # needs larger crops
        pool = Pool(np.pad(pool.images, ((0, 0), (8, 8), (8, 8))), pool.labels + np.array([8, 8, 0]))
        side = sum(arch.margins) + 8
    first, goal = batch(pool, arch, side, 4, kind, True, (1, 0, 7))
    again, same = batch(pool, arch, side, 4, kind, True, (1, 0, 7))
    assert torch.equal(first, again)
    assert all(torch.equal(a, b) for a, b in zip(goal, same, strict=True))
    for other in ((2, 0, 7), (1, 1, 7), (1, 0, 8)):  # seed, rank, step
        assert not torch.equal(first, batch(pool, arch, side, 4, kind, True, other)[0])
    out = side - sum(arch.margins)
    assert first.shape == (4, 1, side, side)
    assert goal.positive.shape == goal.weight.shape == goal.heat.shape == (4, out, out)


def test_batches_do_not_change_over_the_years():
    """Checkpoints resume only if a step's batch stays what it was."""
    rng = np.random.default_rng(0)
    labels = np.full((3, 512, 3), np.nan, np.float32)
    labels[:, :6] = rng.uniform(0, 40, (3, 6, 3)).astype(np.float32).round()
    pool = Pool(rng.integers(0, 256, (3, 40, 40), dtype=np.uint8), labels)
    image, goal = batch(pool, ARCHITECTURES["A"], 30, 5, "minmax", True, (1, 0, 3))
    drawn = np.rint(image.numpy() * 1000).astype(np.int16).tobytes() + goal.positive.numpy().tobytes()
    assert hashlib.sha256(drawn + goal.weight.numpy().tobytes()).hexdigest()[:16] == "289502e4b9688b4a"


def test_labels_of_a_batch_are_in_output_pixels():
    """The 1-pixel corner of a picture lands where a network centred on it answers."""
    images = np.full((1, 41, 41), 10, np.uint8)
    images[0, 20, 20] = 250
    labels = np.full((1, 512, 3), np.nan, np.float32)
    labels[0, 0] = 20, 20, 1
    arch = ARCHITECTURES["A"]
    image, goal = batch(Pool(images, labels), arch, 41, 6, "local", False, (0, 0, 0))
    inner = image[:, 0, 7:-7, 7:-7]
    for picture, positive in zip(inner, goal.positive, strict=True):
        gap = (picture - picture.median()).abs()
        assert positive.flatten().nonzero().ravel().tolist() == [int(gap.argmax())]


def test_workers_share_the_steps():
    loader = torch.utils.data.DataLoader(Batches(_step, 3, 12), batch_size=None, num_workers=0)
    assert [int(step) for step in loader] == list(range(3, 12))


def _step(step):
    return torch.tensor(step)


def test_a_pool_goes_on_with_the_same_bytes(tmp_path, monkeypatch):
    monkeypatch.setattr(samples, "CHUNK", 2)
    steps = []
    whole = make_pool(SMALL, tmp_path, workers=1, progress=lambda done, total: steps.append((done, total)))
    assert steps == [(1, 3), (2, 3), (3, 3)]
    folder = pool_folder(SMALL, tmp_path)
    names = ["00000000.npz", "00000002.npz", "00000004.npz"]
    assert sorted(p.name for p in folder.glob("*.npz")) == names
    before = [(folder / n).read_bytes() for n in names]
    (folder / names[1]).unlink()
    again = make_pool(SMALL, tmp_path, progress=lambda done, total: steps.append((done, total)))
    assert steps[3:] == [(3, 3)]
    assert [(folder / n).read_bytes() for n in names] == before
    assert np.array_equal(whole.images, again.images)
    assert np.array_equal(whole.labels, again.labels, equal_nan=True)


def test_chunks_and_processes_do_not_change_a_pool(tmp_path, monkeypatch, pool):
    monkeypatch.setattr(samples, "CHUNK", 3)
    other = make_pool(SMALL, tmp_path, workers=2)
    assert np.array_equal(pool.images, other.images)
    assert np.array_equal(pool.labels, other.labels, equal_nan=True)


def test_pool_folders_keep_their_names():
    """A pool that was rendered stays of use."""
    assert pool_folder(PoolConfig(), samples.Path()).name == "pool-7b9943bc61e6"
    assert pool_folder(SMALL, samples.Path()) != pool_folder(PoolConfig(), samples.Path())


def test_backgrounds_are_behind_the_boards(tmp_path):
    rng = np.random.default_rng(0)
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(tmp_path / name), rng.integers(0, 256, (300, 1500), dtype=np.uint8))
    (tmp_path / "SOURCE.md").write_text("where they come from")
    pictures = samples.load_backgrounds(str(tmp_path))
    assert [p.shape for p in pictures] == [(200, 1000)] * 2
    assert samples.load_backgrounds("") == []


@pytest.mark.parametrize("workers", [1, 2])
def test_a_folder_without_pictures_is_refused(tmp_path, monkeypatch, workers):
    monkeypatch.setattr(samples, "CHUNK", 2)
    config = PoolConfig(count=4, size=48, backgrounds=str(tmp_path / "nowhere"))
    with pytest.raises(ConfigError, match=r"no pictures in .*nowhere.* --backgrounds DIR, or --backgrounds none"):
        make_pool(config, tmp_path, workers)


@pytest.mark.parametrize("change", [{"ranges": "easy"}, {"count": 0}, {"size": 0}, {"seed": -1}])
def test_wrong_settings_of_a_pool(change):
    with pytest.raises(ConfigError, match=r"pool\."):
        PoolConfig(**change)
