"""A night as one page that needs no network: what came of it, what failed and why, every recording."""

from __future__ import annotations

from html import escape

from trackprofile import __version__
from trackprofile.fleet.job import State
from trackprofile.fleet.night import Night
from trackprofile.fleet.tables import recordings, sentences
from trackprofile.reporting.page import document, plain

ELSEWHERE = "the tables that -o night.csv and --json give"


def html(night: Night, manifest: str) -> str:
    """The page of a night; ``manifest`` is its name."""
    title = f"Recordings of {manifest}"
    said = "".join(f"<li>{escape(one)}</li>" for one in sentences(night))
    table = recordings(night)
    failed = len(night.of(State.FAILED))
    why = {name: table[name][:failed] for name in ("number", "file", "line", "run", "reason")}
    parts = [
        f'<h1>{escape(title)}</h1><p class="where">Store {escape(night.store)}; trackprofile {__version__}</p>',
        f'<ul class="first">{said}</ul>',
        f"<h2>Failed, and why</h2>{plain(why, 'failed', ELSEWHERE)}" if failed else "",
        f"<h2>All recordings</h2>{plain(table, 'recordings', ELSEWHERE)}",
    ]
    return document(title, "\n".join(parts))
