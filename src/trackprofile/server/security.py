"""Security checks of every request, and the security headers of every answer.

A request is refused unless its header ``Host`` is an address or a known name of this server (another name
may have been rebound to this address: DNS rebinding), it comes from this server's own pages or from
no page, it is short, and, where the server requires a token, it presents the token or a session cookie.
"""

from __future__ import annotations

import ipaddress
import json
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from trackprofile.server.session import session_cookie, session_is_valid, token_matches

MAX_QUERY_LENGTH = 2000
MAX_PATH_LENGTH = 200
MAX_HEADER_BYTES = 16_384
MAX_BODY_BYTES = 2000
"""The only body that a client sends is a token."""

OPEN_PATHS = ("/", "/login", "/logout", "/session")
"""Paths without a token: the viewer shows nothing until it may read the store."""

STATIC_PREFIX = "/static/"

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "permissions-policy": "camera=(), geolocation=(), microphone=()",
}

_METHODS_WITH_BODY = {"POST"}


@dataclass(frozen=True)
class SecuritySettings:
    """Settings of the security checks.

    Parameters
    ----------
    names : host names of this server, in addition to its addresses and localhost
    token : token that every client must present; None admits every client that reaches the address
    """

    names: frozenset[str] = frozenset()
    token: str | None = None


@dataclass(frozen=True)
class Refusal:
    """The reason why a request is refused."""

    status: int
    sentence: str


class SecurityMiddleware:
    """ASGI application that checks requests before it passes them to another application."""

    def __init__(self, inner: ASGIApp, settings: SecuritySettings) -> None:
        self.inner, self.settings = inner, settings

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass one request on, or refuse it."""
        if scope["type"] == "lifespan":
            await self.inner(scope, receive, send)
            return
        if scope["type"] != "http":  # the server has no web sockets
            await send({"type": "websocket.close", "code": 1008})
            return
        method = "GET" if scope["method"] == "HEAD" else scope["method"]
        secured_send = _with_security_headers(send, without_body=scope["method"] == "HEAD")
        refused = refusal(scope, self.settings)
        if refused:
            await _send_refusal(refused, secured_send)
            return
        await self.inner({**scope, "method": method}, receive, secured_send)


def refusal(scope: Scope, settings: SecuritySettings) -> Refusal | None:
    """The reason why a request is refused; None admits it."""
    headers = Headers(scope=scope)
    return (
        _check_size(scope, headers)
        or _check_host(headers, settings.names)
        or _check_origin(scope, headers)
        or _check_token(scope, headers, settings.token)
    )


def _check_size(scope: Scope, headers: Headers) -> Refusal | None:
    if len(scope["query_string"]) > MAX_QUERY_LENGTH or len(scope["path"]) > MAX_PATH_LENGTH:
        return Refusal(414, f"The address is longer than {MAX_QUERY_LENGTH} characters.")
    if sum(len(name) + len(value) for name, value in headers.raw) > MAX_HEADER_BYTES:
        return Refusal(431, f"The headers are larger than {MAX_HEADER_BYTES} bytes.")
    length = headers.get("content-length", "0" if scope["method"] not in _METHODS_WITH_BODY else "")
    chunked = "transfer-encoding" in headers
    if chunked or not (length.isascii() and length.isdigit() and len(length) < 10):
        return Refusal(411, "The request needs the header Content-Length.")
    if int(length) > MAX_BODY_BYTES:
        return Refusal(413, f"The body is larger than {MAX_BODY_BYTES} bytes.")
    return None


def _check_host(headers: Headers, names: frozenset[str]) -> Refusal | None:
    hosts = headers.getlist("host")
    if len(hosts) == 1 and is_own_host(hosts[0], names):
        return None
    return Refusal(
        421,
        "This server does not have that host name; start it with --hostname NAME to add the name.",
    )


def is_own_host(host: str, names: frozenset[str]) -> bool:
    """Whether a header ``Host`` is an address, localhost or one of the names.

    Addresses are safe: only names can be rebound to another address.

    Examples
    --------
    >>> names = frozenset({"track.example"})
    >>> [is_own_host(one, names) for one in ("127.0.0.1:8000", "[::1]", "track.example", "evil.example")]
    [True, True, True, False]
    """
    try:
        parts = urlsplit(f"//{host}")
        name, _ = parts.hostname or "", parts.port
    except ValueError:
        return False
    if not name or parts.netloc != host or "@" in host:
        return False
    if name == "localhost" or name in names:
        return True
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _check_origin(scope: Scope, headers: Headers) -> Refusal | None:
    refused = Refusal(403, "In a browser, only this server's own pages may send requests to it.")
    for origin in headers.getlist("origin"):
        if urlsplit(origin).netloc != headers["host"]:
            return refused
    site = headers.get("sec-fetch-site", "none")
    if site in ("same-origin", "none"):
        return None
    # A link on another site may open the viewer, which then sends its own requests.
    opens_viewer = headers.get("sec-fetch-mode") == "navigate" and scope["method"] in (
        "GET",
        "HEAD",
    )
    return None if opens_viewer and scope["path"] == "/" else refused


def _check_token(scope: Scope, headers: Headers, token: str | None) -> Refusal | None:
    path = scope["path"]
    if path in OPEN_PATHS or path.startswith(STATIC_PREFIX) or may_read(headers, token):
        return None
    return Refusal(
        401,
        "This server requires a token: send Authorization: Bearer TOKEN, or log in with a browser.",
    )


def may_read(headers: Headers, token: str | None) -> bool:
    """Whether a request presents the token or a valid session; True for every request without a token."""
    if token is None:
        return True
    kind, _, presented = headers.get("authorization", "").partition(" ")
    if kind.lower() == "bearer" and token_matches(token, presented.strip()):
        return True
    return session_is_valid(token, session_cookie(headers.get("cookie", "")))


def _with_security_headers(send: Send, *, without_body: bool) -> Send:
    """Send with `HEADERS` added to every answer; an answer to HEAD has no body."""

    async def secured_send(message: Message) -> None:
        if message["type"] == "http.response.start":
            MutableHeaders(scope=message).update(HEADERS)
            MutableHeaders(scope=message).setdefault("cache-control", "no-store")
        elif without_body:
            message = {**message, "body": b""}
        await send(message)

    return secured_send


async def _send_refusal(refused: Refusal, send: Send) -> None:
    body = json.dumps({"error": refused.sentence}).encode()
    headers: list[tuple[bytes, Any]] = [
        (b"content-type", b"application/json"),
        (b"content-length", str(len(body)).encode()),
    ]
    if refused.status == 401:
        headers.append((b"www-authenticate", b"Bearer"))
    await send({"type": "http.response.start", "status": refused.status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
