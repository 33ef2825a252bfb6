"""HTML report of a batch, in one file: summary, failed recordings with reasons, all recordings."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from trackprofile import __version__
from trackprofile.fleet.batch import BatchResult
from trackprofile.fleet.batch_tables import recordings, sentences
from trackprofile.fleet.job import JobResult, State
from trackprofile.reporting.html import MAX_ROWS, html_document, html_table

ELSEWHERE = "the tables that -o batch.csv and --json write"


def html(batch: BatchResult, manifest: str) -> str:
    """HTML report of a batch; ``manifest`` is the name of its manifest."""
    title = f"Recordings of {manifest}"
    summary = "".join(f"<li>{escape(one)}</li>" for one in sentences(batch))
    shown = {name: column for name, column in recordings(batch).items() if name != "reason"}
    parts = [
        f'<h1>{escape(title)}</h1><p class="where">Store {escape(batch.store)}; trackprofile {__version__}</p>',
        f'<ul class="first">{summary}</ul>',
        _failed(batch.of(State.FAILED)),
        f"<h2>All recordings</h2>{html_table(shown, 'recordings', ELSEWHERE)}",
    ]
    return html_document(title, "\n".join(parts))


def _failed(outcomes: Sequence[JobResult]) -> str:
    if not outcomes:
        return ""
    items = "".join(
        f"<li>{one.row.number}, {escape(one.row.file.name)} ({escape(one.row.line)}, {escape(one.row.run or '–')}): "
        f"{escape(one.reason)}</li>"
        for one in outcomes[:MAX_ROWS]
    )
    more = len(outcomes) - MAX_ROWS
    rest = f"<p>{more} more are in {ELSEWHERE}.</p>" if more > 0 else ""
    return f'<h2>Failed, and why</h2><ul id="failed">{items}</ul>{rest}'
