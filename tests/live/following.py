"""A camera before which somebody holds the board where the page wants it, not exactly, and a server that has it."""

from __future__ import annotations

import socket
import threading
import time
from contextlib import contextmanager

import numpy as np
import uvicorn
from tests.live.moving_board import SPACING, Renderer, between, pose, towards

from rcdn.cli.live import _tools
from rcdn.geometry import rotation
from rcdn.live.folder import Folder, Settings
from rcdn.live.run import Place, config_of
from rcdn.live.security import names_of
from rcdn.live.server import Server
from rcdn.live.session import Session
from rcdn.terminal.target import DEFAULT

RATE, MOVES, PATIENCE = 15, 8, 30
"""frames a second; frames that a movement takes; frames after which a board that isn't taken is put anew"""


class Hand:
    """A source of frames: the board goes to the pose that the session wants, not exactly, is held there, and put anew
    if it isn't taken."""

    trouble = ""

    def __init__(self, noise=5.0):
        self.session = None
        self._renderer, self._rng = Renderer(noise), np.random.default_rng(2)
        self._here, self._way = pose(0, 0, 0.42), []
        self._wanted, self._held, self._still = None, None, 0

    def read(self):
        begin = time.monotonic()
        state = self.session.state()
        new = state["wanted"] != self._wanted or self._still > PATIENCE
        if new and not state["busy"] and state["wanted"] is not None:
            self._wanted, self._still = state["wanted"], 0
            goal = towards(self._wanted)
            goal[:3, :3] = rotation(self._rng.normal(0, 0.03, 3)) @ goal[:3, :3]
            goal[:3, 3] += self._rng.normal(0, 0.003, 3)
            self._way = [between(self._here, goal, (k + 1) / MOVES) for k in range(MOVES)]
        if self._way:
            self._here, self._held = self._way.pop(0), None
        if self._held is None:
            self._held = self._renderer.frame(self._here, coarse=bool(self._way))
        time.sleep(max(0.0, 1 / RATE - (time.monotonic() - begin)))
        self._still += not state["busy"]
        return (self._held,), time.monotonic()

    def close(self):
        pass


@contextmanager
def served(path, source, cameras=1):
    """The address of a page with rcdn's own guide, whose camera (or `cameras`) is `source`."""
    folder = Folder(path, cameras)
    settings = folder.agree(Settings(SPACING))
    session = source.session = Session(folder, settings, _tools(settings, DEFAULT, 0.1, cameras == 2))
    listening = socket.create_server(("127.0.0.1", 0))
    port = listening.getsockname()[1]
    app = Server(session, source).app(folder.token(), names_of("127.0.0.1", port))
    server = uvicorn.Server(config_of(app, Place()))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    thread.start()
    try:
        yield f"http://127.0.0.1:{port}/{folder.token()}/"
    finally:
        server.should_exit = True
        thread.join(30)
        session.close()
