"""Entries of a store in the command line: filters, selection, and their print."""

from __future__ import annotations

from dataclasses import asdict
from datetime import date
from typing import TYPE_CHECKING, Any

from trackprofile.cli import show
from trackprofile.cli.options import parse_date
from trackprofile.errors import DataError

if TYPE_CHECKING:
    from trackprofile.store import Entry, Store


def entry_filters(
    line: str | None,
    direction: str | None,
    first: str | None,
    last: str | None,
    from_m: float | None,
    to_m: float | None,
) -> dict[str, Any]:
    """The filters of `trackprofile.store.find`."""
    dates: list[date | None] = [None if one is None else parse_date(one) for one in (first, last)]
    return {
        "line": line, "direction": direction, "first": dates[0], "last": dates[1], "start": from_m, "end": to_m,
    }  # fmt: skip


def find_entries(store: Store, filters: dict[str, Any], *, all_versions: bool) -> tuple[Entry, ...]:
    """The entries that match the filters."""
    from trackprofile.store import find

    return find(store, **filters, all_versions=all_versions)


def select_entry(entries: tuple[Entry, ...], name: str) -> Entry:
    """The one entry whose name begins with a text."""
    matches = [one for one in entries if name and one.id.startswith(name)]
    if len(matches) != 1:
        raise DataError(
            f"{name!r}: expected the name of one pass or its beginning, {len(matches)} match; see "
            "`trackprofile store list`."
        )
    return matches[0]


def print_passes(entries: tuple[Entry, ...], *, as_json: bool) -> None:
    """Print a table of entries."""
    if as_json:
        show.as_one_object({"passes": [entry_as_dict(one) for one in entries]})
        return
    show.table(
        ("entry", "line", "direction", "date", "run", "from, m", "to, m", "vehicle", "defects"),
        [
            (one.id, visible(one.line), visible(one.direction), one.day.isoformat(), visible(one.run),
             f"{one.start:.0f}", f"{one.end:.0f}", visible(one.origin.vehicle), str(sum(one.defects.values())))
            for one in entries
        ],
    )  # fmt: skip


def entry_as_dict(entry: Entry) -> dict[str, Any]:
    """An entry for JSON."""
    values = asdict(entry)
    values["key"]["day"] = entry.day.isoformat()
    return values


def pass_table(entries: tuple[Entry, ...]) -> dict[str, list[Any]]:
    """Plain columns with one row per pass."""
    rows: list[dict[str, Any]] = [
        {
            "entry": one.id, "line": one.line, "direction": one.direction, "day": one.day, "run": one.run,
            "start_m": one.start, "end_m": one.end, "points": one.points, "known_share": one.known_share,
            "kind": one.kind,
        }
        | {f"standard_deviation_{band}_mm": 1e3 * value for band, value in one.standard_deviations.items()}
        | {f"defects_{action.replace(' ', '_')}": count for action, count in one.defects.items()}
        | asdict(one.origin)
        for one in entries
    ]  # fmt: skip
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in names}


def visible(name: str) -> str:
    """A text whose control characters are shown as escapes, so that they do not act on the terminal."""
    return "".join(one if one.isprintable() else f"\\u{ord(one):04x}" for one in name)
