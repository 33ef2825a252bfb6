"""`trackprofile serve`: the web viewer of a store."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trackprofile.cli import show
from trackprofile.cli.options import Json, StoreUrl
from trackprofile.errors import FileError


def serve(
    store: StoreUrl,
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="Network address to listen on. Any address other than this machine's own requires a token from "
            "clients; 0.0.0.0 listens on all.",
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int,
        typer.Option(
            min=0, max=65535, metavar="PORT", help="TCP port to listen on; 0 selects a free port."
        ),
    ] = 8000,
    token_file: Annotated[
        Path | None,
        typer.Option(
            "--token-file",
            metavar="FILE",
            help="File that holds the access token. Default: a token is generated and printed once if one is needed.",
        ),
    ] = None,
    hostname: Annotated[
        list[str] | None,
        typer.Option(
            "--hostname",
            metavar="NAME",
            help="Host name under which clients reach this server, such as track.example.org; requests for other "
            "names are refused. Repeatable. Default: localhost and the addresses of this machine.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Serve a web viewer and a JSON API for the passes in a store, which is only read."""
    try:
        from trackprofile.server.serve import bind
        from trackprofile.server.serve import serve as run_server
    except ModuleNotFoundError as error:
        if str(error.name).startswith("trackprofile"):
            raise
        raise FileError(
            f"The web viewer needs {error.name}, which is not installed: pip install 'trackprofile[network]'."
        ) from error
    from trackprofile.server.session import read_token
    from trackprofile.store import lines, open_store

    opened = open_store(store)
    lines(opened)  # reports a damaged entry before the server starts
    token = None if token_file is None else read_token(token_file)
    listening = bind(host, port, token, hostname or ())
    if as_json:
        generated = listening.settings.token if listening.token_generated else None
        show.as_one_object({"address": listening.address, "token": generated})
    else:
        show.say(f"Open {listening.address} in a browser; Ctrl-C ends the server.")
        if listening.token_generated:
            show.say(f"Token, shown only once: {listening.settings.token}")
    run_server(opened, listening)
