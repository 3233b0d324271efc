"""The server: the page's files, thumbnails and results by GET, everything else over one WebSocket."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, suppress
from importlib.resources import files
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from rcdn.errors import RcdnError
from rcdn.live.frames import MOST_BYTES, THUMB, decoded, encoded, side_by_side
from rcdn.live.frames import PREVIEW as PREVIEW_WIDTH
from rcdn.live.messages import HEADER, PAIR, Frame, Wanted, frame_of, preview_of, wish_of
from rcdn.live.security import REPORT_POLICY, Gate
from rcdn.live.session import Session
from rcdn.live.sources import Source
from rcdn.report.target import make_page, to_pdf
from rcdn.types import Array, Checkerboard, Printed

MOST_MESSAGE = MOST_BYTES + HEADER.size
"""largest message, bytes; a longer one ends the connection before it is read completely"""
MOST_PAIR = 2 * MOST_BYTES + HEADER.size + PAIR.size
"""the same for two cameras"""
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}
REPLACED, REFUSED = 4001, 1008
"""close codes of a connection: another page took over; an invalid message was received"""
GONE = (RuntimeError, OSError, WebSocketDisconnect)
"""what sending to a page that is gone, or closing its connection, may raise"""
BOARD = Printed(Checkerboard(9, 6), 0.025)
"""the board offered for printing"""
AHEAD = 2
"""largest number of previews sent but not yet confirmed"""


def page_files() -> dict[str, tuple[bytes, str]]:
    """The page's files: name → (bytes, media type)."""
    folder = files("rcdn.live") / "page"
    names = [f.name for f in folder.iterdir()]
    return {
        name: ((folder / name).read_bytes(), TYPES[Path(name).suffix]) for name in names if Path(name).suffix in TYPES
    }


class Server:
    """Serves one session to one page at a time; a page that connects later takes over. `source`: the server's own
    cameras, None to use the page's."""

    def __init__(self, session: Session, source: Source | None = None) -> None:
        self.session, self._source = session, source
        self._files = page_files()
        self._frame_pool = ThreadPoolExecutor(1, "frames")
        self._thumbs: dict[str, bytes] = {}
        self._page: _Page | None = None
        self._clock = 0.0

    def app(self, token: str, hosts: frozenset[str], secure: bool = False) -> Gate:
        """The ASGI application, wrapped in its access control."""
        routes = [
            WebSocketRoute("/socket", self._socket),
            Route("/thumb/{name}", self._thumb),
            Route("/result/{name}", self._result),
            Route("/board.pdf", self._board),
            Route("/{name:path}", self._file),
        ]
        inner = Starlette(routes=[Mount(f"/{token}", routes=routes)], lifespan=self._lifespan)
        return Gate(inner, token, hosts, secure)

    @asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        loop = asyncio.get_running_loop()
        self.session.changed = lambda: _soon(loop, self._changed)
        reading = None if self._source is None else asyncio.create_task(self._read_source(self._source))
        try:
            yield
        finally:
            if reading is not None:
                reading.cancel()
            self._frame_pool.shutdown(wait=True, cancel_futures=True)
            if self._source is not None:
                self._source.close()

    # ---- files

    async def _file(self, request: Request) -> Response:
        name = request.path_params["name"] or "index.html"
        if name not in self._files:
            return Response("not here\n", 404, media_type="text/plain")
        data, kind = self._files[name]
        return Response(data, media_type=kind)

    async def _thumb(self, request: Request) -> Response:
        name = request.path_params["name"]
        if name not in self.session.state()["views"]:
            return Response("not here\n", 404, media_type="text/plain")
        if name not in self._thumbs:
            folder = self.session.folder
            make = lambda: side_by_side([folder.grey(name, c) for c in range(folder.cameras)], THUMB)  # noqa: E731
            try:
                self._thumbs[name] = await asyncio.get_running_loop().run_in_executor(None, make)
            except RcdnError:
                return Response("not here\n", 404, media_type="text/plain")
        return Response(self._thumbs[name], media_type="image/jpeg")

    async def _result(self, request: Request) -> Response:
        written, name = self.session.state()["written"], request.path_params["name"]
        if written is None or name not in written["files"]:
            return Response("not here\n", 404, media_type="text/plain")
        path = self.session.folder.path / name
        if name.endswith(".html"):
            return FileResponse(path, headers={"content-security-policy": REPORT_POLICY})
        return FileResponse(path, filename=name, media_type="application/octet-stream")

    async def _board(self, _: Request) -> Response:
        """A PDF of a board, for users who have none."""
        headers = {"content-disposition": 'attachment; filename="board.pdf"'}
        return Response(to_pdf(make_page(BOARD)), media_type="application/pdf", headers=headers)

    # ---- the socket

    async def _socket(self, socket: WebSocket) -> None:
        await socket.accept()
        page, before = _Page(socket), self._page
        self._page = page
        writer = asyncio.create_task(page.write())
        code = REFUSED
        try:
            if before is not None:
                await before.end(REPLACED)
            self._changed()
            while page is self._page:
                await self._answer(page, await socket.receive())
        except WebSocketDisconnect:
            code = 0
        except (RcdnError, KeyError, ValueError):
            pass  # an invalid message: the connection is closed, without any other effect
        finally:
            if self._page is page:
                self._page = None
            writer.cancel()
            if code:
                await page.end(code)

    async def _answer(self, page: _Page, message: Any) -> None:
        if message["type"] == "websocket.disconnect":
            raise WebSocketDisconnect(message.get("code", 1000))
        if (data := message.get("bytes")) is not None:
            if self._source is not None:
                raise RcdnError("the server has a camera of its own")
            page.put(await self._see(page, frame_of(data, self.session.folder.cameras)))
        else:
            wanted = wish_of(message.get("text") or "")
            if wanted.wish == "shown":
                page.ahead = max(0, page.ahead - 1)
                return
            try:
                await asyncio.get_running_loop().run_in_executor(None, self._do, wanted)
            except RcdnError as error:
                page.put({"type": "trouble", "text": str(error)})

    def _do(self, wanted: Wanted) -> None:
        match wanted.wish:
            case "begin":
                self.session.begin(wanted.value)
            case "take":
                self.session.take()
            case "remove":
                self.session.remove(wanted.name)
            case "write":
                self.session.write()

    async def _see(self, page: _Page, frame: Frame) -> dict[str, Any]:
        """The response to a frame from the page. Each page's clock is shifted so that its times continue those of the
        previous page."""
        here, *others = frame.times
        if page.clock is None:
            page.clock = max(self._clock, time.monotonic()) - here
        self._clock = max(self._clock, page.clock + here)
        at, loop = self._clock, asyncio.get_running_loop()

        def see() -> dict[str, Any]:
            return self.session.see(tuple(map(decoded, frame.data)), (at, *(at + other - here for other in others)))

        return {**await loop.run_in_executor(self._frame_pool, see), "n": frame.number}

    def _changed(self) -> None:
        """Send the session's state to the page."""
        if self._page is not None:
            state = {**self.session.state(), "source": "browser" if self._source is None else "server"}
            self._page.put(state)

    async def _read_source(self, source: Source) -> None:
        """Process frames of the server's camera while a page is connected; an error that ends this is told there."""
        try:
            await self._read_on(source)
        except Exception as error:
            self.session.notice = f"The camera can't be read any more: {error}"
            self._changed()
            raise

    async def _read_on(self, source: Source) -> None:
        loop, number = asyncio.get_running_loop(), 0
        while True:
            page = self._page
            if page is None or page.ahead >= AHEAD:
                await asyncio.sleep(0.005)
                continue
            got = await loop.run_in_executor(self._frame_pool, source.read)
            if source.trouble != self.session.notice:
                self.session.notice = source.trouble
                self._changed()
            if got is None:
                continue
            number += 1
            with suppress(RcdnError):
                assessment, preview = await loop.run_in_executor(self._frame_pool, self._assessed, number, *got)
                page.ahead += 1
                page.put(preview)
                page.put({**assessment, "n": number})

    def _assessed(self, number: int, pictures: tuple[Array, ...], at: float) -> tuple[dict[str, Any], bytes]:
        """The response to a frame of the server's camera, and its preview."""
        from rcdn.io import as_grey

        assessment = self.session.see(tuple(map(as_grey, pictures)), (at,) * len(pictures))
        return assessment, preview_of(number, [encoded(p, PREVIEW_WIDTH) for p in pictures])


class _Page:
    """A connection: messages to be sent wait in a queue, but only the newest state is sent."""

    def __init__(self, socket: WebSocket) -> None:
        self._socket = socket
        self._queue: asyncio.Queue[bytes | dict[str, Any]] = asyncio.Queue()
        self._state: dict[str, Any] | None = None
        self.clock: float | None = None
        self.ahead = 0

    def put(self, message: bytes | dict[str, Any]) -> None:
        """Queue `message` for sending."""
        if isinstance(message, dict) and message["type"] == "state":
            waiting, self._state = self._state is not None, message
            if waiting:
                return
        self._queue.put_nowait(message)

    async def write(self) -> None:
        """Send the queued messages until the connection ends."""
        with suppress(*GONE):
            while True:
                message = await self._queue.get()
                if isinstance(message, bytes):
                    await self._socket.send_bytes(message)
                    continue
                if message["type"] == "state":
                    message, self._state = self._state or message, None
                await self._socket.send_text(json.dumps(message, allow_nan=False))

    async def end(self, code: int) -> None:
        """Close the connection, if it is open; the other side may be gone already."""
        if self._socket.application_state is WebSocketState.CONNECTED:
            with suppress(*GONE):
                await self._socket.close(code)


def _soon(loop: asyncio.AbstractEventLoop, call: Any) -> None:
    with suppress(RuntimeError):  # the server has stopped meanwhile
        loop.call_soon_threadsafe(call)
