"""The gate before every answer: which requests are let through, and what every answer forbids the browser.

A request is refused unless it names this server by an address or a name that it was given (another
name is one that somebody rebound to this address), comes from this server's own page or from no page
at all, is short, and, where there is a token, says it.
"""

from __future__ import annotations

import ipaddress
import json
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from trackprofile.server.session import cookie_of, session_is_valid, token_matches

LONGEST_QUERY = 2000
LONGEST_PATH = 200
LARGEST_HEADERS = 16_384
LARGEST_BODY = 2000
"""Bytes: of the only thing that is ever sent here, a token."""

OPEN = ("/", "/login", "/logout", "/session")
"""Paths that need no token: the page is empty until it may read the store."""

STATIC = "/static/"

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

_SENDS = {"POST"}


@dataclass(frozen=True)
class SecuritySettings:
    """What the gate goes by.

    Parameters
    ----------
    names : of this server, beside its addresses and localhost
    token : that every reader has to say; None lets everybody in who reaches the address
    """

    names: frozenset[str] = frozenset()
    token: str | None = None


@dataclass(frozen=True)
class Refusal:
    """Why a request is not let through."""

    status: int
    sentence: str


class SecurityMiddleware:
    """An ASGI application in front of another one."""

    def __init__(self, inner: ASGIApp, rules: SecuritySettings) -> None:
        self.inner, self.rules = inner, rules

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let one request through, or refuse it."""
        if scope["type"] == "lifespan":
            await self.inner(scope, receive, send)
            return
        if scope["type"] != "http":  # nothing here speaks over a web socket
            await send({"type": "websocket.close", "code": 1008})
            return
        asked = "GET" if scope["method"] == "HEAD" else scope["method"]
        guarded = _guarded(send, without_body=scope["method"] == "HEAD")
        refused = refusal(scope, self.rules)
        if refused:
            await _refuse(refused, guarded)
            return
        await self.inner({**scope, "method": asked}, receive, guarded)


def refusal(scope: Scope, rules: SecuritySettings) -> Refusal | None:
    """Why a request is refused; None lets it through."""
    headers = Headers(scope=scope)
    return (
        _of_size(scope, headers)
        or _of_host(headers, rules.names)
        or _of_origin(scope, headers)
        or _of_token(scope, headers, rules.token)
    )


def _of_size(scope: Scope, headers: Headers) -> Refusal | None:
    if len(scope["query_string"]) > LONGEST_QUERY or len(scope["path"]) > LONGEST_PATH:
        return Refusal(414, f"The address is longer than {LONGEST_QUERY} characters.")
    if sum(len(name) + len(value) for name, value in headers.raw) > LARGEST_HEADERS:
        return Refusal(431, f"The headers are larger than {LARGEST_HEADERS} bytes.")
    length = headers.get("content-length", "0" if scope["method"] not in _SENDS else "")
    chunked = "transfer-encoding" in headers
    if chunked or not (length.isascii() and length.isdigit() and len(length) < 10):
        return Refusal(411, "Say how long the body is (Content-Length).")
    if int(length) > LARGEST_BODY:
        return Refusal(413, f"The body is larger than {LARGEST_BODY} bytes.")
    return None


def _of_host(headers: Headers, names: frozenset[str]) -> Refusal | None:
    hosts = headers.getlist("host")
    if len(hosts) == 1 and is_own(hosts[0], names):
        return None
    return Refusal(
        421, "This server does not go by that name; start it with --name NAME if it should."
    )


def is_own(host: str, names: frozenset[str]) -> bool:
    """Whether a header ``Host`` is an address, localhost or one of some names.

    Nobody can rebind an address: it is only names that lead elsewhere tomorrow.

    Examples
    --------
    >>> names = frozenset({"track.example"})
    >>> [is_own(one, names) for one in ("127.0.0.1:8000", "[::1]", "track.example", "evil.example")]
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


def _of_origin(scope: Scope, headers: Headers) -> Refusal | None:
    other = Refusal(403, "Only this server's own page may read it from a browser.")
    for origin in headers.getlist("origin"):
        if urlsplit(origin).netloc != headers["host"]:
            return other
    site = headers.get("sec-fetch-site", "none")
    if site in ("same-origin", "none"):
        return None
    # A link from elsewhere opens the page, which shows nothing until it has asked by itself.
    opens = headers.get("sec-fetch-mode") == "navigate" and scope["method"] in ("GET", "HEAD")
    return None if opens and scope["path"] == "/" else other


def _of_token(scope: Scope, headers: Headers, token: str | None) -> Refusal | None:
    path = scope["path"]
    if path in OPEN or path.startswith(STATIC) or may_read(headers, token):
        return None
    return Refusal(401, "Say the token: header Authorization: Bearer TOKEN, or log in on the page.")


def may_read(headers: Headers, token: str | None) -> bool:
    """Whether a request says the token, or has a session that was begun with it; any does where there is none."""
    if token is None:
        return True
    kind, _, said = headers.get("authorization", "").partition(" ")
    if kind.lower() == "bearer" and session_is_valid(token, said.strip()):
        return True
    return token_matches(token, cookie_of(headers.get("cookie", "")))


def _guarded(send: Send, *, without_body: bool) -> Send:
    """The same, with `HEADERS` on every answer; a question for the head gets no body."""

    async def guarded(message: Message) -> None:
        if message["type"] == "http.response.start":
            MutableHeaders(scope=message).update(HEADERS)
            MutableHeaders(scope=message).setdefault("cache-control", "no-store")
        elif without_body:
            message = {**message, "body": b""}
        await send(message)

    return guarded


async def _refuse(refused: Refusal, send: Send) -> None:
    body = json.dumps({"error": refused.sentence}).encode()
    headers: list[tuple[bytes, Any]] = [
        (b"content-type", b"application/json"),
        (b"content-length", str(len(body)).encode()),
    ]
    if refused.status == 401:
        headers.append((b"www-authenticate", b"Bearer"))
    await send({"type": "http.response.start", "status": refused.status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
