"""The recordings of a batch as a table, and its summary in sentences."""

from __future__ import annotations

from typing import Any

from trackprofile.assessment.limits import Action
from trackprofile.assessment.tables import Table
from trackprofile.fleet.batch import BatchProgress, BatchResult
from trackprofile.fleet.job import JobResult, State

BATCH_TABLES = ("recordings",)

_KM = 1e3


def recordings(batch: BatchResult) -> Table:
    """One row per recording: failed recordings with their reasons first, then in the order of the manifest."""
    ordered = sorted(batch.outcomes, key=lambda one: one.state is not State.FAILED)
    rows = [_row(one) for one in ordered]
    return {name: [row[name] for row in rows] for name in rows[0]}


def _row(outcome: JobResult) -> dict[str, Any]:
    row, entry = outcome.row, outcome.entry
    columns: dict[str, Any] = {
        "number": row.number,
        "file": row.file.name,
        "line": row.line,
        "direction": row.direction,
        "day": row.day.isoformat(),
        "run": row.run,
        "state": outcome.state.value,
        "reason": outcome.reason,
        "entry": None if entry is None else entry.id,
        "start_m": None if entry is None else entry.start,
        "end_m": None if entry is None else entry.end,
        "known_share": None if entry is None else entry.known_share,
    }
    for action in reversed(Action):
        columns[action.name.lower()] = None if entry is None else entry.defects.get(action.text, 0)
    return columns | {"wall_s": outcome.wall, "cpu_s": outcome.cpu}


def sentences(batch: BatchResult) -> list[str]:
    """Summary of a batch, the most important sentence first."""
    stored, there, failed = (len(batch.of(state)) for state in State)
    text = [f"{_counted(stored)} stored, {there} there already, {failed} failed."]
    entries = [one.entry for one in batch.of(State.STORED) if one.entry is not None]
    for action in reversed(Action):
        places = sum(entry.defects.get(action.text, 0) for entry in entries)
        if places:
            text.append(f"{places} places in the new passes call for {action.text}.")
    if entries:
        text.append(
            f"{batch.length / _KM:.4g} km of profiles in {duration(batch.wall)} on {batch.workers} workers: "
            f"{1e3 * batch.cpu / batch.length:.3g} ms of computing per metre."
        )
    return text


def describe_progress(now: BatchProgress) -> str:
    """Progress of a batch in one sentence.

    Examples
    --------
    >>> describe_progress(BatchProgress(ended=37, failed=2, total=100, workers=2, remaining=840.0))
    '37 of 100 recordings, 2 failed; 2 workers, 14 min to go.'
    >>> describe_progress(BatchProgress(0, 0, 100, 0, None))
    '0 of 100 recordings; waiting for workers.'
    """
    failed = f", {now.failed} failed" if now.failed else ""
    to_go = "" if now.remaining is None else f", {duration(now.remaining)} to go"
    there = f"{now.workers} workers{to_go}" if now.workers else "waiting for workers"
    return f"{now.ended} of {now.total} recordings{failed}; {there}."


def duration(seconds: float) -> str:
    """A duration as text.

    Examples
    --------
    >>> duration(42), duration(600), duration(9000)
    ('42 s', '10 min', '2.5 h')
    """
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def _counted(recordings: int) -> str:
    return "1 recording" if recordings == 1 else f"{recordings} recordings"
