"""Who gets in, and what a page may do: hostile visitors are refused, and nothing is written."""

from __future__ import annotations

import http.client
import json
import socket
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
import uvicorn
from tests.live import stand_in
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from rcdn.errors import ConfigError
from rcdn.live.folder import Folder, Settings
from rcdn.live.messages import HEADER
from rcdn.live.run import Place, config_of
from rcdn.live.security import check_host, names_of
from rcdn.live.server import Server, page_files
from rcdn.live.session import Session

TOKEN = "t" * 43


@dataclass
class Client:
    """A visitor of a page that is served at `port`."""

    port: int

    @property
    def host(self):
        return f"127.0.0.1:{self.port}"

    def get(self, path, method="GET", **headers):
        """The status, headers and body of the answer; `path` goes out as it is."""
        line = http.client.HTTPConnection("127.0.0.1", self.port, timeout=10)
        line.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
        for name, value in {"host": self.host, **headers}.items():
            line.putheader(name.replace("_", "-"), value)
        line.endheaders()
        answer = line.getresponse()
        found = answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read()
        line.close()
        return found

    def socket(self, token=TOKEN, host="", origin=""):
        """An open socket of the page, or one that another page opens."""
        raw = socket.create_connection(("127.0.0.1", self.port))
        return connect(
            f"ws://{host or self.host}/{token}/socket", sock=raw, origin=origin or f"http://{self.host}", max_size=None
        )


@pytest.fixture
def session(tmp_path):
    folder = Folder(tmp_path / "camera")
    made = Session(folder, folder.agree(Settings(0.03)), stand_in.tools(lambda: None))
    yield made
    made.close()


@contextmanager
def on_loopback(session, cameras=1, source=None):
    """A client of a server for `session`, which ends with it; `source`: the server's own camera."""
    listening = socket.create_server(("127.0.0.1", 0))
    port = listening.getsockname()[1]
    app = Server(session, source).app(TOKEN, names_of("127.0.0.1", port))
    server = uvicorn.Server(config_of(app, Place(), cameras))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    thread.start()
    while not server.started:
        time.sleep(0.01)
    try:
        yield Client(port)
    finally:
        server.should_exit = True
        thread.join(10)
    assert not thread.is_alive()


@pytest.fixture
def client(session):
    with on_loopback(session) as made:
        yield made


def ended(line):
    """The code with which the connection ends; 1006 if it is cut off in the middle of a message."""
    try:
        while True:
            line.recv(timeout=10)
    except ConnectionClosed as end:
        return end.rcvd.code if end.rcvd else 1006
    except OSError:
        return 1006


def files(session):
    return sorted(str(p.relative_to(session.folder.path)) for p in session.folder.path.rglob("*") if p.is_file())


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/", {}),
        ("/index.html", {}),
        (f"/{'u' * 43}/", {}),
        (f"/{TOKEN[:-1]}/", {}),
        (f"/{TOKEN}%C3%A9/", {}),
        (f"/{TOKEN}/", {"host": "evil.example:8642"}),
        (f"/{TOKEN}/", {"host": "127.0.0.1:1"}),
        (f"/{TOKEN}/", {"host": ""}),
        (f"/{TOKEN}/", {"origin": "http://evil.example"}),
        (f"/{TOKEN}/", {"origin": "null"}),
        (f"/{TOKEN}/app.js", {"sec_fetch_site": "cross-site", "sec_fetch_mode": "no-cors"}),
        (f"/{TOKEN}/app.js", {"sec_fetch_site": "same-site", "sec_fetch_mode": "cors"}),
    ],
)
def test_strangers_are_refused(client, path, headers):
    status, _, body = client.get(path, **headers)
    assert (status, body) == (403, b"refused\n")


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "PATCH"])
def test_nothing_but_reading_goes_by_requests(client, method):
    assert client.get(f"/{TOKEN}/", method)[0] == 403


@pytest.mark.parametrize(
    "path",
    [
        "../../etc/passwd", "%2e%2e/session.json", "..%2fsession.json", "thumb/..%2f..%2fsession.json", "session.json",
        "thumb/frame-0001.png", "thumb/%00", "result/report.html", "result/..%2fsession.json", "server.py",
        "page/app.js", ".address",
    ],
)  # fmt: skip
def test_paths_lead_nowhere(client, path):
    assert client.get(f"/{TOKEN}/{path}")[0] in (403, 404)


@pytest.mark.parametrize(
    ("name", "kind"), [("", "text/html"), ("app.js", "text/javascript"), ("style.css", "text/css")]
)
def test_the_page_is_bound(client, name, kind):
    status, headers, _ = client.get(f"/{TOKEN}/{name}")
    policy = headers["content-security-policy"]
    assert status == 200
    assert headers["content-type"].startswith(kind)
    assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self'")
    assert "unsafe" not in policy
    assert f"ws://{client.host}" in policy
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cache-control"] == "no-store"
    assert headers["x-content-type-options"] == "nosniff"
    assert "server" not in headers


def test_a_board_to_print_is_at_hand(client):
    assert client.get(f"/{TOKEN}/board.pdf")[2].startswith(b"%PDF")


def test_the_page_is_small_and_asks_nothing_of_the_network():
    page = page_files()
    assert {"index.html", "style.css", "app.js"} <= set(page)
    assert sum(len(data) for data, _ in page.values()) <= 200_000
    for data, _ in page.values():
        text = data.decode().replace("http://www.w3.org/2000/svg", "")
        assert "http:/" not in text
        assert "https:/" not in text
        assert "innerHTML" not in text


@pytest.mark.parametrize(
    ("host", "origin"),
    [
        ("", "http://evil.example"),
        ("", "https://{ours}"),
        ("", "null"),
        ("evil.example:8642", "http://evil.example:8642"),
        ("evil.example:8642", "http://{ours}"),
    ],
)
def test_a_socket_opens_from_our_page_only(client, host, origin):
    with pytest.raises(InvalidStatus), client.socket(host=host, origin=origin.replace("{ours}", client.host)):
        pass


def test_a_socket_opens_with_the_token_only(client):
    with pytest.raises(InvalidStatus), client.socket("u" * 43):
        pass
    with client.socket() as line:
        assert line.recv(timeout=10)


JPEG = b"\xff\xd8\xff\xe0" + bytes(300)


@pytest.mark.parametrize(
    "message",
    [
        "", "nonsense", "[]", "null", "1" * 600, "[" * 400, '{"wish": "fly"}', '{"wish": "remove", "name": 5}',
        '{"wish": "begin", "value": NaN}', '{"wish": "begin", "value": "1"}',
        '{"wish": "write", "path": "/etc/passwd"}', b"", b"short", HEADER.pack(1, float("nan")) + JPEG,
        HEADER.pack(1, 0.0) + b"no picture", HEADER.pack(1, 0.0) + JPEG, HEADER.pack(1, 0.0) + bytes(7_000_000),
    ],
)  # fmt: skip
def test_garbage_ends_the_connection_and_writes_nothing(client, session, message):
    before = files(session)
    with client.socket() as line:
        assert json.loads(line.recv(timeout=10))["type"] == "state"
        with suppress(ConnectionClosed, OSError):
            line.send(message)
        assert ended(line) in (1006, 1008, 1009)
    assert files(session) == before
    with client.socket() as line:  # others are served
        assert line.recv(timeout=10)


@pytest.mark.parametrize("size", [(8, 8), (60, 5000), (9000, 9000)])
def test_frames_of_no_sensible_size_are_refused(client, size):
    data = cv2.imencode(".jpg", np.zeros(size[::-1], np.uint8))[1].tobytes()
    with client.socket() as line:
        line.send(HEADER.pack(1, 0.0) + data)
        assert ended(line) == 1008


@pytest.mark.parametrize("name", ["../session.json", "frame-0001.png/../../x", "/etc/passwd", "", "frame-0001.png"])
def test_names_of_pictures_that_are_none_remove_nothing(client, session, name):
    before = files(session)
    with client.socket() as line:
        line.recv(timeout=10)
        line.send(json.dumps({"wish": "remove", "name": name}))
        assert json.loads(line.recv(timeout=10)) == {"type": "trouble", "text": "there is no such picture"}
    assert files(session) == before


def test_a_frame_is_answered_by_its_number(client):
    data = cv2.imencode(".jpg", np.zeros((480, 640), np.uint8))[1].tobytes()
    with client.socket() as line:
        line.send(HEADER.pack(77, 5.0) + data)
        answers = [json.loads(line.recv(timeout=10)) for _ in range(3)]
    assessments = [a for a in answers if a["type"] == "look"]
    assert [(a["n"], a["refused"]) for a in assessments[:1]] == [(77, "No board is seen.")]


def test_a_page_that_comes_later_takes_over(client):
    with client.socket() as first:
        first.recv(timeout=10)
        with client.socket() as second:
            assert json.loads(second.recv(timeout=10))["type"] == "state"
            assert ended(first) == 4001


def test_a_page_is_taken_over_that_went_while_its_frame_was_looked_at(session, client, caplog, monkeypatch):
    """As by a reload: the old page is gone, and the server is still busy with its frame when the new one comes."""
    looking, go_on, see = threading.Event(), threading.Event(), session.see

    def slow(greys, times):
        looking.set()
        go_on.wait(20)
        return see(greys, times)

    monkeypatch.setattr(session, "see", slow)
    data = cv2.imencode(".jpg", np.zeros((480, 640), np.uint8))[1].tobytes()
    with client.socket() as first:
        first.recv(timeout=10)
        first.send(HEADER.pack(1, 0.0) + data)
        assert looking.wait(10)
    try:
        with client.socket() as second:
            assert json.loads(second.recv(timeout=10))["type"] == "state"
            go_on.set()
            second.send(HEADER.pack(2, 0.1) + data)
            while json.loads(second.recv(timeout=10)).get("n") != 2:
                pass
    finally:
        go_on.set()
    assert caplog.records == []


@pytest.mark.parametrize("host", ["0.0.0.0", "::", ""])
def test_no_server_at_every_address(host):
    with pytest.raises(ConfigError, match="name the one address"):
        check_host(host, True)


def test_other_machines_by_tls_only():
    with pytest.raises(ConfigError, match="only by TLS"):
        check_host("192.168.1.20", False)
    check_host("192.168.1.20", True)
    assert names_of("192.168.1.20", 8642) == {"192.168.1.20:8642"}
    assert "localhost:8642" in names_of("127.0.0.1", 8642)
    for host in ("127.0.0.1", "::1", "localhost"):
        check_host(host, False)


class Broken:
    """A camera whose driver fails."""

    trouble = ""

    def read(self):
        raise OSError("no such device")

    def close(self):
        pass


def test_a_camera_that_fails_is_told(session):
    with on_loopback(session, source=Broken()) as client, client.socket() as line:
        until = time.monotonic() + 20
        while time.monotonic() < until:
            state = json.loads(line.recv(timeout=10))
            if state.get("trouble"):
                break
        assert state["trouble"] == "The camera can't be read any more: no such device"
