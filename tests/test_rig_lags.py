"""Videos that were started one after the other: brought into step by frames that both show."""

from __future__ import annotations

import numpy as np
import pytest

from rcdn.batch.calibration_runs import BoardReader, Problem
from rcdn.batch.detection_settings import DetectionSettings
from rcdn.batch.inputs import Gathered
from rcdn.batch.rig_runs import solved
from rcdn.config import DetectorConfig
from rcdn.errors import CalibrationError
from rcdn.geometry import rotation
from rcdn.io import ImageResult
from rcdn.terminal.spacing import parse_spacing
from rcdn.types import Corners
from rcdn_lab.camera_scenes import SPACING, board, see
from rcdn_lab.rig_scenes import row

SCENE = row([0.12], ("pinhole",))
LATE = {"c0": 0, "c1": 53.3}
LONG, CHOSEN = 400, 12


class Filmed(BoardReader):
    """Detections of a board that is waved before cameras of which one started its video later; no pictures."""

    def __init__(self):
        super().__init__(DetectionSettings(DetectorConfig(), None, 1, None), CHOSEN)
        self.looked_at = 0

    def gather(self, inputs, numbers=None, cameras=1, behind=False, silent=None):
        name = inputs[0]
        rng = np.random.default_rng(int(name[1:]))
        chosen = sorted(rng.choice(LONG, CHOSEN, replace=False).tolist()) if numbers is None else list(numbers[0])
        chosen = [n for n in chosen if n < LONG]
        self.looked_at += len(chosen)
        images = tuple(self._image(name, n) for n in chosen)
        return Gathered(images, (), (), (tuple(chosen),))

    def check(self, got, spacing):
        pass

    @staticmethod
    def _image(name, number):
        t, T = (number + LATE[name]) / 9, np.eye(4)
        T[:3, :3] = rotation(np.array([0.4 * np.sin(t / 3), 0.4 * np.cos(t / 4), 0.1 * np.sin(t)]))
        T[:3, 3] = [-0.1 + 0.08 * np.sin(t / 5), -0.08 + 0.06 * np.cos(t / 2.3), 0.7 + 0.1 * np.sin(t / 6)]
        ij, xy = see(SCENE.cameras[name], SCENE.places[name] @ np.linalg.inv(SCENE.places["c1"]) @ T)
        noise = np.random.default_rng(number).normal(0, 0.1, xy.shape)
        width, height = SCENE.cameras[name].image_size
        boards = [board(ij, xy + noise, (width, height), np.full(54, 0.1))] if len(ij) == 54 else []
        return ImageResult(f"{name}.mp4#{number:06d}", width, height, Corners(np.zeros((0, 2)), [], []), tuple(boards))


def rig_of(reader, correct_time):
    problem = Problem(parse_spacing(f"{SPACING}m"), "auto", correct_time=correct_time)
    return solved(reader, {name: [name] for name in LATE}, problem, SCENE.cameras)[1]


def test_a_video_that_was_started_later_is_brought_into_step():
    done = rig_of(Filmed(), correct_time=True)
    late = done.shifts["c1"].moments - done.shifts["c0"].moments
    assert late == pytest.approx(53.3, abs=0.02)
    assert len(done.corrected) == 1
    T = done.rig.relative("c0", "c1")[0]
    gap = SCENE.places["c1"] @ np.linalg.inv(SCENE.places["c0"]) @ np.linalg.inv(T)
    assert np.linalg.norm(gap[:3, 3]) < 0.001


def test_other_frames_are_looked_at_only_where_time_is_to_be_corrected():
    reader = Filmed()
    with pytest.raises(CalibrationError, match="no two cameras agree"):
        rig_of(reader, correct_time=False)
    assert reader.looked_at <= 2 * CHOSEN + 2 * 2 * CHOSEN
