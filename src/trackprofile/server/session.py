"""The server's token, and the session cookie that a browser gets for it.

The cookie is not the token: it holds its time of expiry and HMAC-SHA-256(token, that time). The server
therefore keeps no list of sessions, and a stolen cookie expires.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from http.cookies import CookieError, SimpleCookie
from pathlib import Path

from trackprofile.errors import FileError

COOKIE = "trackprofile"
SESSION_SECONDS = 12 * 3600
"""Time that a browser stays logged in [s]."""

MIN_TOKEN_LENGTH = 20
"""Minimum number of characters of a token, so that a program cannot guess it."""

_MAX_FILE_BYTES = 4096


def new_token() -> str:
    """A token of 256 random bits."""
    return secrets.token_urlsafe(32)


def read_token(path: Path) -> str:
    """Read a token from a file that contains nothing else.

    Raises
    ------
    FileError : the file cannot be read, or has no token of sufficient length.
    """
    try:
        with path.open("rb") as file:
            text = file.read(_MAX_FILE_BYTES).decode("ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(
            f"{path}: expected a file with a token, but it cannot be read ({error}); check path and permissions."
        ) from error
    if len(text) < MIN_TOKEN_LENGTH or not text.isprintable() or " " in text:
        raise FileError(
            f"{path}: expected one word of at least {MIN_TOKEN_LENGTH} characters as the token; "
            "generate one with: openssl rand -hex 32."
        )
    return text


def token_matches(token: str, presented: str) -> bool:
    """Whether a presented text is the token; the comparison takes the same time if it is not."""
    return hmac.compare_digest(token.encode(), presented.encode())


def new_session(token: str, now: float | None = None) -> str:
    """Value of a cookie that is valid for `SESSION_SECONDS` from now.

    Examples
    --------
    >>> value = new_session("a token of many letters", now=1000.0)
    >>> session_is_valid("a token of many letters", value, now=1001.0)
    True
    >>> session_is_valid("another token", value, now=1001.0)
    False
    """
    ends = int((time.time() if now is None else now) + SESSION_SECONDS)
    return f"{ends}.{_signed(token, ends)}"


def session_is_valid(token: str, value: str, now: float | None = None) -> bool:
    """Whether the value of a cookie was made from the token and has not expired."""
    text, _, signature = value.partition(".")
    if not (text.isascii() and text.isdigit() and len(text) < 12):
        return False
    ends = int(text)
    signed = hmac.compare_digest(_signed(token, ends).encode(), signature.encode())
    return signed and ends > (time.time() if now is None else now)


def session_cookie(header: str) -> str:
    """Value of the session cookie in a header ``Cookie``; empty without one."""
    try:
        cookie = SimpleCookie(header).get(COOKIE)
    except CookieError:
        return ""
    return cookie.value if cookie else ""


def _signed(token: str, ends: int) -> str:
    return hmac.new(token.encode(), f"session until {ends}".encode(), hashlib.sha256).hexdigest()
