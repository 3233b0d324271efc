"""The server's process: address, TLS, and termination by Ctrl-C."""

from __future__ import annotations

import socket
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rcdn.errors import ConfigError, OutputError
from rcdn.live.folder import Folder
from rcdn.live.security import check_host, names_of
from rcdn.live.server import MOST_MESSAGE, MOST_PAIR, Server
from rcdn.live.session import Session
from rcdn.live.sources import Source

if TYPE_CHECKING:
    import uvicorn

    from rcdn.live.security import Gate

BACKLOG = 32
"""largest number of concurrent requests"""


@dataclass(frozen=True)
class Place:
    """Address of the page: `host` and `port` (0: the last one used, or any free one); for TLS, `certificate` and
    `key`."""

    host: str = "127.0.0.1"
    port: int = 0
    certificate: Path | None = None
    key: Path | None = None

    @property
    def secure(self) -> bool:
        """Whether TLS is used."""
        return self.certificate is not None

    def check(self) -> None:
        """Raise ConfigError for an address that would be insecurely open to other machines, or can't work."""
        check_host(self.host, self.secure)
        if (self.certificate is None) != (self.key is None):
            raise ConfigError("--certificate and --key belong together; give both")
        for name, path in (("--certificate", self.certificate), ("--key", self.key)):
            if path is not None and not path.is_file():
                raise ConfigError(f"{name} {path}: no such file; check the path")


def serve(
    folder: Folder, session: Session, source: Source | None, place: Place, announce: Callable[[str], None]
) -> None:
    """Serve the page until Ctrl-C; `announce` is called with its address as soon as it can be opened."""
    import uvicorn

    listening = _listen(place, folder.port())
    port = listening.getsockname()[1]
    folder.keep_port(port)
    token = folder.token()
    app = Server(session, source).app(token, names_of(place.host, port), place.secure)
    shown = f"[{place.host}]" if ":" in place.host else place.host
    announce(f"{'https' if place.secure else 'http'}://{shown}:{port}/{token}/")
    try:
        uvicorn.Server(config_of(app, place, folder.cameras)).run(sockets=[listening])
    finally:
        listening.close()
        session.close()


def config_of(app: Gate, place: Place, cameras: int = 1) -> uvicorn.Config:
    """uvicorn's configuration for `app`: without an access log, since that would reveal the token, and without messages
    larger than a frame of all `cameras`."""
    import uvicorn

    return uvicorn.Config(
        app,
        ws="websockets-sansio",
        ws_max_size=MOST_MESSAGE if cameras == 1 else MOST_PAIR,
        ws_max_queue=4,
        ws_per_message_deflate=False,
        limit_concurrency=BACKLOG,
        timeout_graceful_shutdown=1,
        access_log=False,
        log_level="error",
        server_header=False,
        date_header=False,
        proxy_headers=False,
        ssl_certfile=None if place.certificate is None else str(place.certificate),
        ssl_keyfile=None if place.key is None else str(place.key),
    )


def _listen(place: Place, before: int) -> socket.socket:
    """A listening socket; if no port is requested, at the last port used, if that is free."""
    try:
        family, _, _, _, address = socket.getaddrinfo(place.host, place.port, type=socket.SOCK_STREAM)[0]
    except OSError as error:
        raise ConfigError(f"--host {place.host}: is no address ({error.strerror or error}); check it") from error
    reason: OSError | None = None
    for port in dict.fromkeys([place.port] if place.port else [before, 0]):
        listening = socket.socket(family, socket.SOCK_STREAM)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((address[0], port))
            listening.listen(BACKLOG)
            return listening
        except OSError as error:
            listening.close()
            reason = error
    raise OutputError(f"--host {place.host} --port {place.port}: can't be opened ({reason}); choose another port")
