"""A session that a test drives by frames, with a board where the test puts it."""

from __future__ import annotations

import time

from rcdn.live.folder import Folder, Settings
from rcdn.live.session import Session

opened = []
"""sessions that are to be closed, whatever comes of a test"""


class AnyDesk:
    """A session in a folder of `cameras`, whose board is where `at` says; `look` shows it one frame more."""

    patience = 20
    """s to wait for a state"""

    def __init__(self, path, tools, cameras=1):
        self.at = (100.0, 100.0)
        self.folder = Folder(path, cameras)
        opened.append(self)
        self.session = Session(self.folder, self.folder.agree(Settings(0.03)), tools)
        self.time = 0.0

    def until(self, met):
        """Frames until `met(state)`; the state."""
        end = time.monotonic() + self.patience
        while time.monotonic() < end:
            self.look()
            if met(state := self.session.state()):
                return state
            time.sleep(0.005)
        raise AssertionError(self.session.state())

    def take(self, count):
        """Pictures until there are `count`."""
        for k in range(len(self.session.state()["views"]), count):
            self.at = (60.0 + 60 * (k % 6), 60.0 + 90 * (k // 6))
            self.until(lambda s, k=k: len(s["views"]) == k + 1 and len(s["history"]) == k + 1)
        return self.session.state()


def close_all():
    """End all sessions."""
    while opened:
        opened.pop().session.close()
