"""The page in a real browser, from the first frame to the written camera, on rendered videos."""

from __future__ import annotations

import json
import os

import cv2
import numpy as np
import pytest
from tests.live.browser import STATS, Live, begin, complaints, open_browser, until, views
from tests.live.following import Hand, served
from tests.live.moving_board import CAMERA, Renderer, pose, write_video

from rcdn.geometry import rotation
from rcdn.io import read_camera
from rcdn.live.folder import Folder

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one at a time: each takes more than a core
WANTED = [
    [0.005, -0.005, 0.026, -0.1, -0.065, 0.421], [-0.495, 0.349, -0.084, -0.15, -0.039, 0.251],
    [0.439, -0.586, -0.011, -0.081, -0.039, 0.112], [-0.507, -0.585, -0.019, -0.165, -0.025, 0.266],
    [-0.492, 0.437, 0.1, 0.01, -0.053, 0.243], [-0.973, -0.255, -0.108, -0.185, 0.007, 0.317],
    [0.508, 0.545, 0.024, -0.091, -0.07, 0.22], [0.593, 0.577, 0.016, -0.098, -0.059, 0.222],
]  # fmt: skip
"""rotation vectors, rad, and translations, m: about what the guide asks for"""
OTHERS = [
    pose(-0.06, 0.04, 0.3, 28, -25), pose(0.07, 0.04, 0.28, -32, -20), pose(0.06, -0.04, 0.26, -25, 28),
    pose(0.0, 0.03, 0.22, 5, -38), pose(0.02, -0.02, 0.24, 38, 4, 8), pose(-0.08, -0.03, 0.3, 30, 30),
]  # fmt: skip


def placed(numbers):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation(np.array(numbers[:3])), numbers[3:]
    return T


@pytest.fixture(scope="module")
def moving(tmp_path_factory):
    """A board that is moved through many poses and held still in each."""
    path = tmp_path_factory.mktemp("video") / "moving.mjpeg"
    return write_video(path, [*map(placed, WANTED), *OTHERS], hold=1.3, move=0.6)


@pytest.fixture
def opened():
    """What is ended after a test, whatever comes of it."""
    things = []
    yield things
    for end in reversed(things):
        end()


def test_the_whole_way_from_the_first_frame_to_the_camera(tmp_path, opened):
    """With rcdn's guide, and somebody who does what the page says."""
    hand = Hand()
    browser = open_browser(tmp_path / "none.mjpeg")
    opened.append(browser.quit)
    place = tmp_path / "camera"
    with served(place, hand) as address:
        begin(browser, address, "")
        until(browser, lambda b: b.find_element("id", "verdict").is_displayed(), 400)
        print(
            "\npictures:",
            views(browser),
            "|",
            browser.find_element("id", "worst").text,
            browser.find_element("id", "goal").text,
        )
        print(browser.find_element("id", "verdict").text, "|", browser.find_element("id", "lines").text)
        assert complaints(browser) == []
        camera = read_camera(place / "camera.yaml")
        print(
            "f, c px:",
            np.round([camera.K[0, 0], camera.K[1, 1], *camera.K[:2, 2]], 2),
            "true:",
            CAMERA.K[0, 0],
            CAMERA.K[:2, 2],
        )
        assert pytest.approx(CAMERA.K, abs=4) == camera.K
        for name in ("camera_info.yaml", "camera.json", "calibration.json", "report.html"):
            assert (place / name).stat().st_size > 200
        assert len(list((place / "pictures").glob("*.png"))) == views(browser)
        browser.find_element("link text", "Open the report").click()
        until(browser, lambda b: len(b.window_handles) == 2, 10)
        browser.switch_to.window(browser.window_handles[1])
        until(browser, lambda b: "Camera calibration" in b.page_source, 10)


def test_the_browsers_camera_is_quick_enough_to_follow(moving, tmp_path, opened):
    """Frames with guidance while pictures are taken and calculated with. The bounds are those of a machine
    that others use, too."""
    live = Live(tmp_path / "camera")
    opened.append(live.close)
    browser = open_browser(moving)
    opened.append(browser.quit)
    begin(browser, live.address)
    until(browser, lambda b: views(b) >= 2, 90)
    until(browser, lambda b: b.execute_script("return window.live.looks") > 150, 60)
    stats = browser.execute_script(STATS)
    print("\nframes a second, latency in ms:", json.dumps(stats), "| load:", os.getloadavg()[0])
    assert stats["rate"] > 4
    assert stats["median"] < 500
    assert complaints(browser) == []
    code, output = live.end()
    assert code == 130
    assert "goes on" in output
    assert "Traceback" not in output


def test_blurred_frames_are_refused_every_one(tmp_path, opened):
    video = write_video(
        tmp_path / "blurred.mjpeg",
        [pose(x, 0, 0.47, across) for x, across in ((-0.05, 15), (0.06, -10))],
        motion=30,
        hold=1.2,
        move=0.4,
    )
    live = Live(tmp_path / "camera", "--spacing", "25mm")
    opened.append(live.close)
    browser = open_browser(video)
    opened.append(browser.quit)
    begin(browser, live.address, "")
    browser.find_element("id", "take").click()  # nor by hand
    until(browser, lambda b: b.execute_script("return window.live.looks") > 80, 60)
    stats = browser.execute_script(STATS)
    assert stats["refused"] == stats["looks"]
    assert views(browser) == 0
    assert not list((tmp_path / "camera" / "pictures").glob("*"))


def test_a_video_without_a_board_never_holds_the_page_up(tmp_path, opened):
    renderer = Renderer(noise=6)
    video = tmp_path / "empty.mjpeg"
    frames = [renderer.frame() for _ in range(10)]
    video.write_bytes(b"".join(cv2.imencode(".jpg", f)[1].tobytes() for f in frames))
    live = Live(tmp_path / "camera", "--spacing", "25mm")
    opened.append(live.close)
    browser = open_browser(video)
    opened.append(browser.quit)
    begin(browser, live.address, "")
    until(browser, lambda b: b.find_element("id", "hint").text == "No board is seen.", 20)
    before = browser.execute_script("return window.live.looks")
    until(browser, lambda b: b.execute_script("return window.live.looks") > before + 60, 30)
    print("\nwithout a board:", json.dumps(browser.execute_script(STATS)))
    assert views(browser) == 0
    assert complaints(browser) == []


def test_a_reload_and_a_killed_server_lose_nothing(moving, tmp_path, opened):
    live = Live(tmp_path / "camera")
    opened.append(live.close)
    browser = open_browser(moving)
    opened.append(browser.quit)
    begin(browser, live.address)
    until(browser, lambda b: views(b) >= 1, 60)
    browser.refresh()
    until(browser, lambda b: b.find_element("id", "stage").is_displayed() and views(b) >= 1, 20)
    until(browser, lambda b: b.execute_script("return window.live.looks") > 5, 20)
    live.end(kill=True)
    until(browser, lambda b: "isn't running" in b.find_element("id", "banner").text, 10)
    folder = Folder(tmp_path / "camera")
    kept = folder.names()
    folder.close()
    assert len(kept) >= 1
    again = Live(tmp_path / "camera")
    opened.append(again.close)
    assert again.address == live.address
    until(browser, lambda b: not b.find_element("id", "banner").is_displayed(), 20)
    until(browser, lambda b: views(b) > len(kept), 120)
    browser.find_element("css selector", "#views li[data-name] button").send_keys(
        "\n"
    )  # and one is removed by the keyboard
    until(browser, lambda b: kept[0] not in [p.name for p in (tmp_path / "camera" / "pictures").glob("*.png")], 20)
