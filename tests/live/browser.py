"""A real browser with a video for a camera, and the server as users start it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
STATS = """
const {latencies, shown, looks, refused} = window.live, sorted = [...latencies].sort((a, b) => a - b);
const span = (shown.at(-1) - shown[0]) / 1000;
return {rate: (shown.length - 1) / span, median: sorted[sorted.length >> 1],
  most: sorted[Math.floor(0.95 * sorted.length)], looks, refused};
"""


def open_browser(video, devices=1):
    """Chromium without a window, whose camera shows `video` in a loop; None: whose `devices` show its own test picture.
    Skips the test where there is none."""
    selenium = pytest.importorskip("selenium.webdriver")
    if CHROMIUM is None or DRIVER is None:
        pytest.skip("Chromium and chromedriver aren't installed: the page is not tried in a browser")
    options = selenium.ChromeOptions()
    options.binary_location = CHROMIUM
    words = [
        "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--mute-audio",
        "--window-size=1280,900",
        "--use-fake-ui-for-media-stream", f"--use-fake-device-for-media-stream=device-count={devices}",
    ]  # fmt: skip
    if video is not None:
        words[-1:] = ["--use-fake-device-for-media-stream", f"--use-file-for-fake-video-capture={video}"]
    for word in words:
        options.add_argument(word)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    return selenium.Chrome(options=options, service=selenium.ChromeService(DRIVER))


def show_as(browser, size, dark):
    """Show the page in a window of `size`, px, and for people who want it `dark` or not."""
    features = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    # also narrower than Chromium's window can be
    metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": size[0] < 500}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)


class Live:
    """`rcdn live` as a process of its own; `address` of its page."""

    def __init__(self, folder, *options):
        command = [sys.executable, "-m", "rcdn", "live", str(folder), "--no-open", *options]
        self.process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
        )
        line = self.process.stdout.readline()
        found = re.fullmatch(r"Open (https?://\S+)\n", line)
        assert found, line + self.process.stderr.read()
        self.address = found[1]

    def end(self, kill=False):
        """Ctrl-C, or `kill -9`; gives the exit code and what was said."""
        if kill:
            self.process.kill()
        else:
            self.process.send_signal(2)
        out, err = self.process.communicate(timeout=60)
        return self.process.returncode, out + err

    def close(self):
        """End it, if it hasn't."""
        if self.process.returncode is None:
            self.end(kill=True)


def until(browser, met, seconds):
    """Wait until `met(browser)` is true; its value."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if found := met(browser):
            return found
        time.sleep(0.1)
    hint = browser.execute_script(
        "return ['hint', 'sentence', 'banner', 'views-title'].map((i) => document.getElementById(i).textContent)"
    )
    raise AssertionError(f"not within {seconds} s; the page says {hint}")


def views(browser):
    """How many pictures the page shows."""
    return len(browser.find_elements("css selector", "#views li[data-name]"))


def begin(browser, address, spacing="25"):
    """What a person does first, by the keyboard alone."""
    browser.get(address)
    until(browser, lambda b: b.find_element("id", "go").is_displayed(), 10)
    field = browser.find_element("id", "spacing")
    field.send_keys(spacing)
    field.send_keys("\n")
    until(browser, lambda b: b.find_element("id", "stage").is_displayed(), 10)


def complaints(browser):
    """What the browser's console has against the page, but for connections that ended with the server."""
    return [e["message"] for e in browser.get_log("browser") if "WebSocket connection" not in e["message"]]
