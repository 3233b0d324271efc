"""Videos whose files state different frame rates."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import typer

from rcdn.batch.calibration_outputs import Outputs
from rcdn.batch.calibration_runs import BoardReader, Problem, two_cameras
from rcdn.batch.detection_settings import DetectionSettings
from rcdn.batch.inputs import Gathered
from rcdn.batch.rig_poses import rig_poses
from rcdn.batch.rig_runs import many_cameras
from rcdn.batch.video_rates import rates_note
from rcdn.config import DetectorConfig
from rcdn.errors import RcdnError
from rcdn.io import ImageResult, write_rig
from rcdn.terminal.spacing import parse_spacing
from rcdn.types import Corners, Pose, Rig
from rcdn_lab.camera_scenes import CAMERAS

NO_CORNERS = Corners(np.zeros((0, 2)), [], [])
CODE = cv2.VideoWriter.fourcc(*"MJPG")


def image(name):
    return ImageResult(name, 64, 48, NO_CORNERS, ())


@pytest.fixture
def films(tmp_path, monkeypatch):
    """Makes videos of these rates: for each the detections in its one frame."""
    monkeypatch.chdir(tmp_path)

    def make(**rates):
        for name, rate in rates.items():
            writer = cv2.VideoWriter(f"{name}.avi", CODE, rate, (64, 48))
            if not writer.isOpened():
                pytest.skip("this OpenCV writes no video")
            writer.write(np.zeros((48, 64, 3), np.uint8))
            writer.release()
        return {name: Gathered((image(f"{name}.avi#000000"),), (), (), ((0,),)) for name in rates}

    return make


def test_rates_that_differ_are_told_with_a_remedy(films):
    assert rates_note(films(left=10, right=5).values()) == (
        "note: left.avi has 10 frames a second, right.avi 5; frames of one number count as taken at one moment. Unless "
        "they were, whatever the files state, keep one of 2 frames of left.avi, from the first on, as a new video"
    )
    three = films(a=20, b=10, c=30).values()
    assert "keep one of 2 frames of a.avi and one of 3 frames of c.avi, from" in rates_note(three)
    assert rates_note(films(a=24, b=30).values()).endswith(
        "convert them to 24 frames a second, or record them again at one rate"
    )


def test_equal_rates_and_pictures_need_no_word(films):
    assert rates_note(films(a=30, b=29.97).values()) == ""
    made = films(a=10, b=5)
    assert rates_note([made["a"], Gathered((image("b/1.png"),), (), (), ())]) == ""
    assert rates_note([made["a"], Gathered((), (), (), ((),))]) == ""


def rig_of(reader, problem, outputs):
    many_cameras(reader, ["left.avi", "right.avi"], problem, outputs)


def pair_of(reader, problem, outputs):
    two_cameras(reader, ["left.avi", "right.avi"], problem, outputs, None)


def poses_of(reader, problem, _):
    write_rig("rig.json", Rig(("left", "right"), (CAMERAS["pinhole"],) * 2, (Pose(np.eye(4)), Pose(np.eye(4)))))
    rig_poses(Path("rig.json"), ["left.avi", "right.avi"], problem.spacing, reader.settings, None)


@pytest.mark.parametrize("run", [rig_of, pair_of, poses_of])
def test_commands_on_several_cameras_tell_the_rates(films, monkeypatch, capsys, run):
    made = films(left=10, right=5)

    def gather(_, inputs, *more, **settings):
        return made[inputs[0].removesuffix(".avi")]

    for reads in (BoardReader, DetectionSettings):
        monkeypatch.setattr(reads, "gather", gather)
    reader = BoardReader(DetectionSettings(DetectorConfig(), None, 1, None), 40)
    with pytest.raises((RcdnError, typer.Exit)):  # there are no boards
        run(reader, Problem(parse_spacing("25mm"), "auto"), Outputs([], None, None, None, False, ()))
    assert "left.avi has 10 frames a second, right.avi 5" in capsys.readouterr().err
