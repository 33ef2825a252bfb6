"""A server on a free port of this machine, as `trackprofile serve` runs it, in a thread."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from threading import Thread

import httpx

from trackprofile.server.serve import bind, server
from trackprofile.store import Store


@contextmanager
def serving(
    store: Store, token: str | None = None, names: Sequence[str] = ()
) -> Iterator[httpx.Client]:
    """A client of a server of a store, without headers of its own."""
    on = bind("127.0.0.1", 0, token, names)
    running = server(store, on)
    thread = Thread(target=running.run, kwargs={"sockets": [on.socket]})
    thread.start()
    try:
        with httpx.Client(base_url=on.address, timeout=60.0, trust_env=False) as client:
            yield client
    finally:
        running.should_exit = True
        thread.join()
        on.socket.close()
