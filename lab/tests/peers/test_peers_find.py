"""Every peer that is installed, on rendered boards: right labels, and positions in our pixels."""

import os
from dataclasses import replace

import numpy as np
import pytest

from rcdn.metrics import match
from rcdn_lab.peers import PEERS, mrgingham, quiet
from rcdn_lab.sweep import picture
from rcdn_lab.sweep.score import Answers, score
from rcdn_lab.sweep.settings import BASE

SEEDS = range(3)


@pytest.fixture(params=list(PEERS))
def peer(request):
    """A peer that can run here; the others are skipped."""
    reason = PEERS[request.param].missing()
    if reason:
        pytest.skip(f"{request.param}: {reason}")
    return PEERS[request.param]


@pytest.fixture(scope="module")
def clean():
    """Clean pictures by size of board, each made once."""
    made = {}

    def get(size):
        if size not in made:
            made[size] = [picture(replace(BASE, noise=0.0, square=30, tilt=5.0), [3, k], size) for k in SEEDS]
        return made[size]

    return get


def test_a_clean_board(peer, clean):
    """The mean offset tells a wrong origin of pixels, half a pixel of it at least."""
    size = peer.board or (9, 6)
    with quiet():
        find = peer.load()
    offsets = []
    for made in clean(size):
        truth = Answers(made.boards, [np.ones(len(b.xy)) for b in made.boards])
        with quiet():
            grids = find(made.image, size)
        done = score(grids, truth, peer.raw)
        assert (done.hits, done.mislabelled) == (len(truth.xy), 0)
        assert done.success is (None if peer.raw else True)
        for grid in grids:
            pairs, _ = match(grid.xy, truth.xy, 3)
            offsets.append(grid.xy[pairs[:, 0]] - truth.xy[pairs[:, 1]])
    least = (
        0.25 if peer.name == "mate" else 0.05
    )  # a small network has a bias of its own; a wrong origin is half a pixel
    assert np.abs(np.concatenate(offsets).mean(axis=0)).max() < least


def test_a_picture_without_a_board(peer):
    with quiet():
        grids = peer.load()(np.full((240, 320), 128, np.uint8), peer.board or (9, 6))
    assert grids == []


def test_a_peer_has_a_version(peer):
    assert peer.version() not in ("", "?")


def test_names_are_keys():
    assert all(name == peer.name for name, peer in PEERS.items())
    assert len(PEERS) == 14


def test_quiet_holds_the_output_of_other_languages(capfd):
    with quiet():
        os.write(1, b"chatter\n")
    os.write(1, b"after\n")
    assert capfd.readouterr().out == "after\n"


def test_what_mrgingham_prints_is_read():
    """Its table, without the program."""
    size = (3, 3)
    lines = [f"/tmp/p.png {10.5 + 20 * i} {30.25 + 20 * j} 0" for j in range(3) for i in range(3)]
    text = "\n".join(["## generated with mrgingham", "# filename x y level", *lines, ""])
    (grid,) = mrgingham._read(text, size)
    assert grid.xy[5].tolist() == [50.5, 50.25]
    assert grid.ij[5].tolist() == [2, 1]
    assert mrgingham._read("# filename x y level\n/tmp/p.png - - -\n", size) == []
