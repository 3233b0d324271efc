"""A guide of two cameras as simple as can be, beside that of one in `stand_in`."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from tests.live import stand_in

from rcdn.calibration.guidance.pair_progress import PairProgress
from rcdn.live.session import Tools, Written

SIZES = ((640, 480), (800, 600))
GREYS = tuple(np.random.default_rng(k).integers(0, 256, (h, w), np.uint8) for k, (w, h) in enumerate(SIZES))


class Guide:
    """Takes every moment whose left board the guide of one camera takes; the right one counts if it is there."""

    size = (4, 3)

    def __init__(self, image_sizes, spacing):
        self.image_sizes, self.moments, self.one = image_sizes, {}, stand_in.Guide(image_sizes[0], spacing)

    def look(self, boards, time, greys=None):
        assessment = self.one.look(boards[0], time)
        sides = (assessment, stand_in.answer("", "", arrow=None))
        used = tuple(b is not None for b in boards)
        return SimpleNamespace(
            sides=sides,
            used=used,
            refused=assessment.refused,
            hint=assessment.hint,
            take=assessment.take,
            fit=assessment.fit,
        )

    def add(self, boards, name):
        return self.add_all({name: boards})

    def add_all(self, moments):
        self.moments = {**self.moments, **moments}
        self.one.add_all({k: m[0] for k, m in moments.items()})
        return self.progress

    def remove(self, name):
        self.moments = {k: m for k, m in self.moments.items() if k != name}
        self.one.remove(name)
        return self.progress

    @property
    def progress(self):
        one = self.one.progress
        box = SimpleNamespace(outline=np.array([[200.0, 150], [440, 150], [440, 330], [200, 330]]))
        maps = None if one.map is None else (one.map, one.map, np.where(one.map < 0.06, np.nan, one.map))
        wanted = SimpleNamespace(views=(box, None))
        return PairProgress(
            one.views, None, wanted, one.worst, (one.worst,) * 3, maps, one.target, one.done, one.sentence
        )


def write(folder, names, moments, settings):
    assert all(len(m) == 2 for m in moments)
    (folder / "cameras.yaml").write_text("%YAML:1.0\n")
    (folder / "report.html").write_text("<p>report</p>")
    return Written((folder / "cameras.yaml", folder / "report.html"), "good", ("good: use it",))


def tools(found):
    """What a session works with: `found(width)` is the board in every picture of that width."""
    here = lambda grey: found(grey.shape[1])  # noqa: E731
    # the follower looks at reduced pictures: 800 px wide ones are looked at with 640
    return Tools(Guide, lambda grey, close: found(640), lambda grey: [b for b in [here(grey)] if b is not None], write)
