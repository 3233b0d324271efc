"""Access control of the page's server: the token in the address, the host and the origin are checked before any request
is processed.

Another page in the same browser can send requests to this machine, but doesn't know the token; a foreign host name that
resolves to this machine (DNS rebinding) is not among the accepted hosts; and a page that learnt the address can't open
the socket, since its origin differs.
"""

from __future__ import annotations

import hmac
import ipaddress
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from rcdn.errors import ConfigError

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]

PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; media-src blob:; connect-src "
    "'self' {socket}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; require-trusted-types-for 'script'; "
    "trusted-types rcdn"
)
REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'; sandbox"
)
"""content security policy of the report, a single file that embeds its styles and pictures, and needs no script"""


def names_of(host: str, port: int) -> frozenset[str]:
    """Accepted values of the header Host for a server at `host` and `port`."""
    shown = f"[{host}]" if ":" in host else host
    names = {shown} | ({"localhost", "127.0.0.1", "[::1]"} if is_loopback(host) else set())
    return frozenset(f"{name}:{port}" for name in names) | (frozenset(names) if port in (80, 443) else frozenset())


def is_loopback(host: str) -> bool:
    """Whether `host` is reachable from this machine only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def check_host(host: str, secure: bool) -> None:
    """Raise ConfigError if the page at `host` would be open to the network without TLS, or at unspecified addresses."""
    if host in ("", "0.0.0.0", "::", "*"):
        raise ConfigError(
            f"--host {host or '(empty)'}: name the one address of this machine that the other one reaches, "
            "such as 192.168.1.20"
        )
    if not is_loopback(host) and not secure:
        raise ConfigError(
            f"--host {host}: other machines only by TLS: add --certificate and --key, "
            "or --self-signed (browsers give a page no camera otherwise)"
        )


class Gate:
    """ASGI middleware that accepts requests with the `token` as the first part of the path, one of the `hosts` as Host,
    and no origin other than the server's own.

    `secure`: whether TLS is used. It adds headers to the responses that restrict the page.
    """

    def __init__(self, app: Callable[..., Awaitable[None]], token: str, hosts: frozenset[str], secure: bool) -> None:
        self._app, self._token, self._hosts, self._secure = app, token, hosts, secure

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = _single(scope)
        if headers is None or not self._allowed(scope, headers):
            await _refuse(scope, send)
            return
        await self._app(scope, receive, self._bound(headers[b"host"].decode("latin-1"), send))

    def _allowed(self, scope: Scope, headers: dict[bytes, bytes]) -> bool:
        given = str(scope["path"]).split("/")[1:2]
        if not hmac.compare_digest("".join(given).encode("utf-8", "replace"), self._token.encode()):
            return False
        host = headers.get(b"host", b"").decode("latin-1").lower()
        if host not in self._hosts:
            return False
        origin = headers.get(b"origin")
        ours = f"{'https' if self._secure else 'http'}://{host}".encode("latin-1")
        if scope["type"] == "websocket":
            return origin == ours
        if scope["method"] not in ("GET", "HEAD") or (origin is not None and origin != ours):
            return False
        site, mode = headers.get(b"sec-fetch-site", b"none"), headers.get(b"sec-fetch-mode", b"")
        return site in (b"none", b"same-origin") or mode == b"navigate"

    def _bound(self, host: str, send: Send) -> Send:
        policy = PAGE_POLICY.format(socket=f"{'wss' if self._secure else 'ws'}://{host}")

        async def bound(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                message = {**message, "headers": [*message.get("headers", []), *_headers(message, policy)]}
            await send(message)

        return bound


def _headers(message: MutableMapping[str, Any], policy: str) -> list[tuple[bytes, bytes]]:
    """The headers to add to a response; those that the response already has are kept."""
    there = {name.lower() for name, _ in message.get("headers", [])}
    wanted = {
        "content-security-policy": policy,
        "x-content-type-options": "nosniff",
        "x-frame-options": "DENY",
        "referrer-policy": "no-referrer",
        "cache-control": "no-store",
        "permissions-policy": "camera=(self), microphone=(), geolocation=(), display-capture=()",
        "cross-origin-opener-policy": "same-origin",
        "cross-origin-resource-policy": "same-origin",
    }
    return [(k.encode(), v.encode("latin-1")) for k, v in wanted.items() if k.encode() not in there]


def _single(scope: Scope) -> dict[bytes, bytes] | None:
    """The request's headers; None if one of those that are checked occurs twice."""
    found: dict[bytes, bytes] = {}
    for name, value in scope["headers"]:
        if name in (b"host", b"origin") and name in found:
            return None
        found[name] = value
    return found


async def _refuse(scope: Scope, send: Send) -> None:
    """Refuse the request without stating the reason."""
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})
        return
    headers = [(b"content-type", b"text/plain"), (b"content-length", b"8")]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": b"refused\n"})
