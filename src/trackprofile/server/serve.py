"""Listening: on this machine alone, or on the network behind a token."""

from __future__ import annotations

import contextlib
import ipaddress
import socket
from collections.abc import Sequence
from dataclasses import dataclass

import uvicorn

from trackprofile.errors import FileError
from trackprofile.server.app import page_app
from trackprofile.server.security import LARGEST_HEADERS, SecuritySettings
from trackprofile.server.session import new_token
from trackprofile.store import Store

_WAITING = 128


@dataclass(frozen=True)
class Listener:
    """A socket that is bound, and who may speak to it.

    Parameters
    ----------
    socket : that listens
    rules : of the gate
    made : whether the token was made here, for this time only
    """

    socket: socket.socket
    rules: SecuritySettings
    made: bool

    @property
    def address(self) -> str:
        """To be opened in a browser."""
        host, port = self.socket.getsockname()[:2]
        host = "localhost" if _is_everywhere(host) else host
        return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"


def listener(host: str, port: int, token: str | None = None, names: Sequence[str] = ()) -> Listener:
    """Bind to an address; one that others reach is never without a token.

    Parameters
    ----------
    host, port : to listen on; port 0 takes any that is free
    token : that readers have to say; None makes one where the address is not of this machine alone
    names : that this server goes by, beside its addresses and localhost

    Raises
    ------
    FileError : the address is none of this machine's, or the port is taken.
    """
    try:
        family, _, _, _, address = socket.getaddrinfo(host or "0.0.0.0", port, type=socket.SOCK_STREAM)[0]  # fmt: skip
        bound = socket.socket(family, socket.SOCK_STREAM)
    except OSError as error:
        raise FileError(
            f"{host}: no address of this machine ({error.strerror or error})."
        ) from error
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind(address)
        bound.listen(_WAITING)  # who comes before the server runs is not turned away
    except OSError as error:
        bound.close()
        raise FileError(
            f"{host}, port {port}: cannot listen there ({error.strerror or error}); "
            "choose another with --port or --host."
        ) from error
    alone = ipaddress.ip_address(bound.getsockname()[0]).is_loopback
    made = token is None and not alone
    rules = SecuritySettings(
        frozenset(name.lower() for name in names), new_token() if made else token
    )
    return Listener(bound, rules, made)


def serve(store: Store, on: Listener) -> None:
    """Answer until interrupted, which is how it ends."""
    with contextlib.suppress(KeyboardInterrupt):
        server(store, on).run(sockets=[on.socket])


def server(store: Store, on: Listener) -> uvicorn.Server:
    """The server that `serve` runs."""
    return uvicorn.Server(
        uvicorn.Config(
            page_app(store, on.rules),
            log_level="warning",
            access_log=False,
            server_header=False,
            date_header=True,
            ws="none",
            limit_concurrency=200,
            timeout_keep_alive=15,
            h11_max_incomplete_event_size=2 * LARGEST_HEADERS,
            http="h11",
            lifespan="on",
        )
    )


def _is_everywhere(host: str) -> bool:
    return ipaddress.ip_address(host).is_unspecified
