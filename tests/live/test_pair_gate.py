"""What a page may send of two cameras: pairs of frames, and nothing else."""

from __future__ import annotations

import json
from contextlib import suppress

import cv2
import numpy as np
import pytest
from tests.live import stand_in_pair
from tests.live.test_gate import TOKEN, ended, files, on_loopback
from websockets.exceptions import ConnectionClosed

from rcdn.live.folder import Folder, Settings
from rcdn.live.frames import MOST_BYTES
from rcdn.live.messages import HEADER, PAIR, frame_of, preview_of
from rcdn.live.session import Session

JPEG = cv2.imencode(".jpg", np.zeros((480, 640), np.uint8))[1].tobytes()


def message(number=1, times=(5.0, 6.0), pictures=(JPEG, JPEG), length=None):
    """A pair of frames as the page sends it, with a wrong `length` of the first one if given."""
    length = len(pictures[0]) if length is None else length
    return HEADER.pack(number, times[0]) + PAIR.pack(times[1], length) + b"".join(pictures)


@pytest.fixture
def session(tmp_path):
    folder = Folder(tmp_path / "rig", 2)
    made = Session(folder, folder.agree(Settings(0.03)), stand_in_pair.tools(lambda width: None))
    yield made
    made.close()


@pytest.fixture
def client(session):
    with on_loopback(session, 2) as made:
        yield made


def answer_to(client, sent):
    """The answer about the frames that were `sent`."""
    with client.socket() as line:
        line.send(sent)
        while (answer := json.loads(line.recv(timeout=10)))["type"] != "look":
            pass
    return answer


def test_a_pair_of_frames_is_answered_by_its_number(client):
    assessment = answer_to(client, message(77))
    assert (assessment["n"], assessment["refused"]) == (77, "No board is seen.")
    assert len(assessment["sides"]) == 2


def test_the_server_refuses_frames_that_are_too_far_apart(client):
    assert (
        answer_to(client, message(5, (5.0, 105.0)))["refused"]
        == "The cameras' pictures are 100 ms apart; at most 40 ms are allowed"
    )


@pytest.mark.parametrize(
    "sent",
    [
        HEADER.pack(1, 5.0) + JPEG,
        message(times=(5.0, float("nan"))),
        message(times=(float("inf"), 5.0)),
        message(length=0),
        message(length=2 * len(JPEG)),
        message(length=2**32 - 1),
        message(length=7),
        message(pictures=(JPEG, b"no picture")),
        message(pictures=(b"no picture", JPEG)),
        message(pictures=(JPEG, b"")),
        HEADER.pack(1, 5.0) + PAIR.pack(5.0, 1),
        HEADER.pack(1, 5.0) + b"12",
        message(pictures=(JPEG, bytes(MOST_BYTES + 1))),
        message(pictures=(bytes(MOST_BYTES), bytes(MOST_BYTES + 1))),
    ],
    ids=range(14),
)
def test_garbage_ends_the_connection_and_writes_nothing(client, session, sent):
    before = files(session)
    with client.socket() as line:
        assert json.loads(line.recv(timeout=10))["type"] == "state"
        with suppress(ConnectionClosed, OSError):
            line.send(sent)
        assert ended(line) in (1006, 1008, 1009)
    assert files(session) == before
    with client.socket() as line:  # others are served
        assert line.recv(timeout=10)


def test_pictures_of_a_pair_come_back_as_they_were_sent():
    frame = frame_of(message(3, (1000.0, 1020.0), (JPEG, JPEG + b"2")), 2)
    assert (frame.number, frame.times, frame.data) == (3, (1.0, 1.02), (JPEG, JPEG + b"2"))
    for parts in ([b"one"], [b"left", b"the right one"]):
        sent = preview_of(9, parts)
        assert sent.endswith(b"".join(parts))
        assert len(sent) == 4 * len(parts) + sum(map(len, parts))


def test_what_was_taken_is_shown_side_by_side(client, session):
    session._views.append(session.folder.add_moment(stand_in_pair.GREYS, (stand_in_pair.stand_in.board((9, 9)), None)))
    status, headers, body = client.get(f"/{TOKEN}/thumb/frame-0001.png")
    assert (status, headers["content-type"]) == (200, "image/jpeg")
    picture = cv2.imdecode(np.frombuffer(body, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture.shape[1] == 640
    for path in (
        "thumb/left/frame-0001.png",
        "thumb/..%2fleft%2fframe-0001.png",
        "left/frame-0001.png",
        "result/..%2fleft%2fframe-0001.png",
    ):
        assert client.get(f"/{TOKEN}/{path}")[0] in (403, 404)
