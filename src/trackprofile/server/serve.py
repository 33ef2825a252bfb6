"""Run the server: on this machine only, or on the network with a token."""

from __future__ import annotations

import contextlib
import ipaddress
import socket
from collections.abc import Sequence
from dataclasses import dataclass

import uvicorn

from trackprofile.errors import FileError
from trackprofile.server.app import viewer_app
from trackprofile.server.security import MAX_HEADER_BYTES, SecuritySettings
from trackprofile.server.session import new_token
from trackprofile.store import Store

_BACKLOG = 128


@dataclass(frozen=True)
class Listener:
    """A listening socket and the security settings of its server.

    Parameters
    ----------
    socket : bound socket
    settings : of the security checks
    token_generated : whether the token was generated for this run
    """

    socket: socket.socket
    settings: SecuritySettings
    token_generated: bool

    @property
    def address(self) -> str:
        """Address to open in a browser."""
        host, port = self.socket.getsockname()[:2]
        host = "localhost" if _is_unspecified(host) else host
        return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"


def bind(host: str, port: int, token: str | None = None, names: Sequence[str] = ()) -> Listener:
    """Bind to an address; an address that other machines reach always has a token.

    Parameters
    ----------
    host, port : address to listen on; port 0 takes a free port
    token : token that clients must present; None generates one unless the address is a loopback address
    names : host names of this server, in addition to its addresses and localhost

    Raises
    ------
    FileError : this machine does not have the address, or the port is in use.
    """
    try:
        family, _, _, _, address = socket.getaddrinfo(host or "0.0.0.0", port, type=socket.SOCK_STREAM)[0]  # fmt: skip
        bound = socket.socket(family, socket.SOCK_STREAM)
    except OSError as error:
        raise FileError(
            f"{host}: this machine does not have the address ({error.strerror or error}); choose another with --host."
        ) from error
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind(address)
        bound.listen(_BACKLOG)  # connections before the server runs wait
    except OSError as error:
        bound.close()
        raise FileError(
            f"{host}, port {port}: cannot listen on this address ({error.strerror or error}); "
            "choose another with --port or --host."
        ) from error
    is_loopback = ipaddress.ip_address(bound.getsockname()[0]).is_loopback
    generated = token is None and not is_loopback
    settings = SecuritySettings(
        frozenset(name.lower() for name in names), new_token() if generated else token
    )
    return Listener(bound, settings, generated)


def serve(store: Store, listener: Listener) -> None:
    """Answer requests until interrupted."""
    with contextlib.suppress(KeyboardInterrupt):
        server(store, listener).run(sockets=[listener.socket])


def server(store: Store, listener: Listener) -> uvicorn.Server:
    """The uvicorn server that `serve` runs."""
    return uvicorn.Server(
        uvicorn.Config(
            viewer_app(store, listener.settings),
            log_level="warning",
            access_log=False,
            server_header=False,
            date_header=True,
            ws="none",
            limit_concurrency=200,
            timeout_keep_alive=15,
            h11_max_incomplete_event_size=2 * MAX_HEADER_BYTES,
            http="h11",
            lifespan="on",
        )
    )


def _is_unspecified(host: str) -> bool:
    return ipaddress.ip_address(host).is_unspecified
