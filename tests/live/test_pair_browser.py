"""The page of two cameras in a real browser, on rendered videos."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.live.browser import STATS, Live, begin, complaints, open_browser, show_as, until, views
from tests.live.following import served
from tests.live.moving_board import pose
from tests.live.two_cameras import T_RIGHT_LEFT, Hands, write_side_by_side

from rcdn.io import read_stereo
from rcdn.live.folder import Folder

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("browser")]  # one at a time: each takes more than a core
POSES = [
    pose(0.03, 0, 0.42), pose(0.0, 0.02, 0.36, 25, -20), pose(0.06, 0.02, 0.38, -28, -18),
    pose(0.02, -0.03, 0.36, -20, 25), pose(0.05, 0.0, 0.33, 4, -35), pose(0.03, -0.01, 0.35, 35, 5, 10),
]  # fmt: skip


BOXES = """
return ["stage", "stage-right"].map((name) => {
  const box = document.getElementById(name).getBoundingClientRect();
  return [box.left, box.top, box.width];
});"""
NAMED = """
return [...document.querySelectorAll("#work button, #work input")].filter((e) => e.offsetParent).map(
  (e) => e.tabIndex >= 0 && !!(e.textContent || e.labels?.length || e.getAttribute("aria-label")));"""


@pytest.fixture(scope="module")
def moving(tmp_path_factory):
    """Both cameras side by side in one video: a board that is moved through many poses and held still in each."""
    return write_side_by_side(tmp_path_factory.mktemp("video") / "pair.mjpeg", POSES, hold=1.6, move=0.6)


@pytest.fixture
def opened():
    """What is ended after a test, whatever comes of it."""
    things = []
    yield things
    for end in reversed(things):
        end()


def choose_halves(browser):
    browser.execute_script("document.getElementById('device-right').value = 'halves'")


def started(browser, address):
    """As `begin`, with the pictures of one camera that hold both."""
    browser.get(address)
    until(browser, lambda b: b.find_element("id", "go").is_displayed(), 10)
    assert browser.find_element("id", "device-right").is_displayed()
    choose_halves(browser)
    browser.find_element("id", "spacing").send_keys("25\n")
    until(browser, lambda b: b.find_element("id", "stage-right").is_displayed(), 10)


def test_the_whole_way_from_the_first_pair_to_both_cameras(tmp_path, opened):
    """With rcdn's guide, and somebody who does what the page says."""
    browser = open_browser(tmp_path / "none.mjpeg")
    opened.append(browser.quit)
    place = tmp_path / "rig"
    with served(place, Hands(), 2) as address:
        begin(browser, address, "")
        until(browser, lambda b: b.find_element("id", "verdict").is_displayed(), 900)
        print(
            "\npairs:",
            views(browser),
            "|",
            browser.find_element("id", "worst").text,
            browser.find_element("id", "goal").text,
        )
        print(browser.find_element("id", "verdict").text, "|", browser.find_element("id", "lines").text)
        assert complaints(browser) == []
        found = read_stereo(place / "cameras.yaml")
        turn = np.degrees(Rotation.from_matrix(found.T_right_left[:3, :3] @ T_RIGHT_LEFT[:3, :3].T).magnitude())
        baseline = np.linalg.norm(found.T_right_left[:3, 3]), np.linalg.norm(T_RIGHT_LEFT[:3, 3])
        print(f"baseline: {baseline[0]:.5f} m, true {baseline[1]:.5f}; angle off by {turn:.4f}°")
        assert baseline[0] == pytest.approx(baseline[1], rel=0.005)
        assert turn < 0.1
        for name in (
            "cameras.json",
            "camera_info_left.yaml",
            "camera_info_right.yaml",
            "calibration.json",
            "report.html",
        ):
            assert (place / name).stat().st_size > 200
        assert len(list((place / "left").glob("*.png"))) == len(list((place / "right").glob("*.png"))) == views(browser)
        browser.find_element("link text", "Open the report").click()
        until(browser, lambda b: len(b.window_handles) == 2, 10)


def test_one_picture_that_holds_both_is_quick_enough_to_follow(moving, tmp_path, opened):
    """Two pictures of 1280 × 720 px. The bounds are those of a machine that others use, too."""
    live = Live(tmp_path / "rig", "--stereo")
    opened.append(live.close)
    browser = open_browser(moving)
    opened.append(browser.quit)
    started(browser, live.address)
    until(browser, lambda b: views(b) >= 1, 120)
    until(browser, lambda b: b.execute_script("return window.live.looks") > 120, 120)
    stats = browser.execute_script(STATS)
    print("\npairs a second, latency in ms:", json.dumps(stats), "| load:", os.getloadavg()[0])
    assert stats["rate"] > 1
    assert complaints(browser) == []
    code, output = live.end()
    assert code == 130
    assert "--stereo` goes on" in output
    assert "Traceback" not in output


def test_two_cameras_of_the_browser_are_asked_for(tmp_path, opened):
    """The browser's own test pictures, of two devices: both are shown, and pairs of frames arrive."""
    live = Live(tmp_path / "rig", "--stereo", "--spacing", "25mm")
    opened.append(live.close)
    browser = open_browser(None, devices=2)
    opened.append(browser.quit)
    begin(browser, live.address, "")
    until(browser, lambda b: b.execute_script("return window.live.looks") > 10, 60)
    names = browser.execute_script(
        "return ['video', 'video-right'].map((i) => "
        "document.getElementById(i).srcObject.getVideoTracks()[0].getSettings().deviceId)"
    )
    assert names[0] != names[1]
    until(browser, lambda b: "ms apart" not in b.find_element("id", "hint").text, 5)
    assert complaints(browser) == []


def test_a_reload_and_a_killed_server_lose_nothing(moving, tmp_path, opened):
    live = Live(tmp_path / "rig", "--stereo")
    opened.append(live.close)
    browser = open_browser(moving)
    opened.append(browser.quit)
    started(browser, live.address)
    until(browser, lambda b: views(b) >= 1, 120)
    browser.refresh()
    until(browser, lambda b: b.find_element("id", "stage-right").is_displayed() and views(b) >= 1, 30)
    until(browser, lambda b: b.execute_script("return window.live.looks") > 5, 30)
    live.end(kill=True)
    until(browser, lambda b: "isn't running" in b.find_element("id", "banner").text, 20)
    folder = Folder(tmp_path / "rig", 2)
    kept = folder.names()
    folder.close()
    assert kept
    again = Live(tmp_path / "rig", "--stereo")
    opened.append(again.close)
    assert again.address == live.address
    until(browser, lambda b: not b.find_element("id", "banner").is_displayed(), 30)
    until(browser, lambda b: views(b) >= len(kept), 60)
    assert {p.name for side in ("left", "right") for p in (tmp_path / "rig" / side).glob("*.png")} >= set(kept)


def test_nothing_is_wider_than_the_window_and_all_is_reached_by_tab(tmp_path, opened):
    browser = open_browser(tmp_path / "none.mjpeg")
    opened.append(browser.quit)
    with served(tmp_path / "rig", Hands(), 2) as address:
        begin(browser, address, "")
        until(browser, lambda b: b.execute_script("return window.live.looks") > 2, 30)
        for size in ((390, 844), (768, 1024), (1280, 900), (1920, 1080)):
            for dark in (False, True):
                show_as(browser, size, dark)
                seen = browser.execute_script("return window.live.looks")
                until(browser, lambda b, seen=seen: b.execute_script("return window.live.looks") > seen + 1, 30)
                shape = browser.execute_script("return [document.documentElement.scrollWidth, window.innerWidth]")
                boxes, named = browser.execute_script(BOXES), browser.execute_script(NAMED)
                assert shape[0] <= shape[1] == size[0], (size, dark)
                assert boxes[0][2] == pytest.approx(boxes[1][2], abs=1), (size, dark)
                beside = boxes[1][0] > boxes[0][0] and boxes[0][1] == boxes[1][1]
                assert beside == (size[0] >= 600), (size, dark)
                assert named, (size, dark)
                assert all(named), (size, dark)
