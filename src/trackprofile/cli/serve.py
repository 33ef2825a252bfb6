"""`trackprofile serve`: the page over a store."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trackprofile.cli import show
from trackprofile.cli.options import Json
from trackprofile.errors import FileError


def serve(
    store: Annotated[str, typer.Option("--store", metavar="S", help="A folder, or a URL.")],
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS", help="To listen on; others than this machine need a token."
        ),
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 takes any that is free.")] = 8000,
    token_file: Annotated[
        Path | None,
        typer.Option(
            "--token-file",
            metavar="FILE",
            help="Holds the token; without, one is made and printed once.",
        ),
    ] = None,
    name: Annotated[
        list[str] | None,
        typer.Option(
            "--name",
            metavar="NAME",
            help="That this server goes by, such as track.example.org. Repeatable.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Show a store's lines in a browser, and as JSON to other programs; nothing is written."""
    try:
        from trackprofile.server.serve import bind
        from trackprofile.server.serve import serve as answer
    except ModuleNotFoundError as error:
        if str(error.name).startswith("trackprofile"):
            raise
        raise FileError(
            f"The page needs {error.name}, which is not installed: pip install 'trackprofile[network]'."
        ) from error
    from trackprofile.server.session import read_token
    from trackprofile.store import lines, open_store

    there = open_store(store)
    lines(there)  # an entry that is damaged is told now
    token = None if token_file is None else read_token(token_file)
    on = bind(host, port, token, name or ())
    if as_json:
        show.as_one_object(
            {"address": on.address, "token": on.settings.token if on.token_generated else None}
        )
    else:
        show.say(f"Open {on.address} in a browser; Ctrl-C ends it.")
        if on.token_generated:
            show.say(f"Token, said this once: {on.settings.token}")
    answer(there, on)
