"""Who has the token, and the cookie that a browser is given for it.

The cookie is not the token: it holds the time at which it ends and HMAC-SHA-256(token, that time),
so that the server keeps no list of sessions, and a stolen cookie ends by itself.
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
LASTS = 12 * 3600
"""Seconds that a browser stays logged in."""

SHORTEST = 20
"""Characters of a token: what a program cannot guess."""

_LARGEST_FILE = 4096


def new_token() -> str:
    """A token of 256 random bits."""
    return secrets.token_urlsafe(32)


def read_token(path: Path) -> str:
    """The token that is all of a file's text.

    Raises
    ------
    FileError : the file cannot be read, or holds no token that is long enough.
    """
    try:
        with path.open("rb") as file:
            text = file.read(_LARGEST_FILE).decode("ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(
            f"{path}: expected a file that holds a token, and cannot read it ({error})."
        ) from error
    if len(text) < SHORTEST or not text.isprintable() or " " in text:
        raise FileError(
            f"{path}: expected a token of {SHORTEST} characters or more in one word; "
            "make one with: openssl rand -hex 32."
        )
    return text


def session_is_valid(token: str, said: str) -> bool:
    """Whether what was said is the token; takes as long where it is not."""
    return hmac.compare_digest(token.encode(), said.encode())


def new_session(token: str, now: float | None = None) -> str:
    """The value of a cookie that lasts `LASTS` from now.

    Examples
    --------
    >>> value = new_session("a token of many letters", now=1000.0)
    >>> holds("a token of many letters", value, now=1001.0), holds("another token", value, now=1001.0)
    (True, False)
    """
    ends = int((time.time() if now is None else now) + LASTS)
    return f"{ends}.{_signed(token, ends)}"


def token_matches(token: str, value: str, now: float | None = None) -> bool:
    """Whether a cookie's value was made from the token and has not ended."""
    text, _, signature = value.partition(".")
    if not (text.isascii() and text.isdigit() and len(text) < 12):
        return False
    ends = int(text)
    signed = hmac.compare_digest(_signed(token, ends).encode(), signature.encode())
    return signed and ends > (time.time() if now is None else now)


def cookie_of(header: str) -> str:
    """The session in a header ``Cookie``; empty where there is none."""
    try:
        found = SimpleCookie(header).get(COOKIE)
    except CookieError:
        return ""
    return found.value if found else ""


def _signed(token: str, ends: int) -> str:
    return hmac.new(token.encode(), f"session until {ends}".encode(), hashlib.sha256).hexdigest()
