"""`trackprofile store add | list | show | export | verify | tidy`: every pass over a network, in one place."""

from __future__ import annotations

from dataclasses import asdict
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trackprofile.cli import show
from trackprofile.cli.assess import (
    FilterPasses,
    LimitsName,
    Profile,
    Speed,
    WayFile,
    judged,
    way_of,
)
from trackprofile.cli.options import From, Json, To, day_of, read_as
from trackprofile.errors import DataError

if TYPE_CHECKING:
    import xarray as xr

    from trackprofile.assessment.assess import Assessment
    from trackprofile.positioning.chainage import ChainageTable
    from trackprofile.store import Entry, Origin, Store

PASSES = "passes"

app = typer.Typer(
    help="Every pass over a network's lines: profiles and assessments, in a folder or at a URL.",
    no_args_is_help=True,
)

At = Annotated[
    str, typer.Option("--store", metavar="S", help="A folder, or a URL such as s3://bucket/passes.")
]
OfLine = Annotated[str | None, typer.Option("--line", metavar="L", help="Its passes only.")]
OfDirection = Annotated[str | None, typer.Option("--direction", metavar="D", help="Only that.")]
First = Annotated[str | None, typer.Option("--first", metavar="DAY", help="From this day on.")]
Last = Annotated[str | None, typer.Option("--last", metavar="DAY", help="Up to this day.")]
AllVersions = Annotated[
    bool, typer.Option("--all-versions", help="Not only the newest of each recording.")
]
Which = Annotated[str, typer.Argument(metavar="ENTRY", help="Its name, or how that begins.")]


@app.command()
def add(
    profile: Profile,
    at: At,
    line: Annotated[str, typer.Option(metavar="L", help="That was passed.")],
    direction: Annotated[str, typer.Option(metavar="D", help="Such as up or down.")],
    day: Annotated[str, typer.Option(metavar="DAY", help="Such as 2026-05-31.")],
    speed: Speed,
    run: Annotated[
        str, typer.Option(metavar="R", help="Which pass of the day: its time, or the train.")
    ] = "",
    limits: LimitsName = "en-13848",
    way: WayFile = None,
    passes: FilterPasses = 1,
    revision: Annotated[
        int, typer.Option(min=0, help="Of several versions of a recording the greatest is shown.")
    ] = 0,
    as_json: Json = False,
) -> None:
    """Assess a profile and store both; the same again changes nothing. A store that is not there is begun."""
    from trackprofile import store as stores

    place = stores.PassKey(line, direction, day_of(day), run)
    measured, along = read_as(profile, "profile"), way_of(way)
    found = judged(measured, limits, speed, passes)
    origin = _origin(measured, profile.name, found, along, revision)
    added = stores.add(stores.create(at), place, measured, found, origin, chainage=along)
    notes = list(found.notes)
    if not added.shown:
        notes.append("Another version of this recording stays the one shown: see --revision")
    if as_json:
        show.as_one_object(
            {"new": added.new, "shown": added.shown, "notes": notes, "entry": _as_dict(added.entry)}
        )
        return
    show.note([f"{note}." for note in notes])
    done = "Stored as" if added.new else "It was there already:"
    size = sum(one.size for one in added.entry.files.values())
    show.say(f"{done} {added.entry.id}, {size / 1e6:.2f} MB in {len(added.entry.files)} files.")


@app.command("list")
def list_passes(
    at: At,
    line: OfLine = None,
    direction: OfDirection = None,
    first: First = None,
    last: Last = None,
    from_m: From = None,
    to_m: To = None,
    all_versions: AllVersions = False,
    as_json: Json = False,
) -> None:
    """List the lines that are there; of a line or of days, their passes."""
    from trackprofile.store import lines, open_store

    store = open_store(at)
    narrowed = (line, direction, first, last, from_m, to_m)
    if all_versions or any(one is not None for one in narrowed):
        _list(_found(store, *narrowed, all_versions=all_versions), as_json=as_json)
        return
    there = lines(store)
    if as_json:
        show.as_one_object(
            {
                "lines": [
                    asdict(one) | {"days": [day.isoformat() for day in one.days]} for one in there
                ]
            }
        )
        return
    show.table(
        ("line", "direction", "from, m", "to, m", "passes", "first day", "last day"),
        [
            (_visible(one.line), _visible(one.direction), f"{one.start:.0f}", f"{one.end:.0f}", str(one.passes),
             one.days[0].isoformat(), one.days[-1].isoformat())
            for one in there
        ],
    )  # fmt: skip


@app.command("show")
def show_pass(which: Which, at: At, as_json: Json = False) -> None:
    """Show what is known of a pass: where, when, from what, how, and how well."""
    from trackprofile.store import open_store

    entry = _one(open_store(at), which)
    if as_json:
        show.as_one_object(_as_dict(entry))
        return
    rows = [("entry", entry.id), ("line", entry.line), ("direction", entry.direction)]
    rows += [("day", entry.day.isoformat()), ("run", entry.run)]
    rows += [("from, to", f"{entry.start:.2f} m, {entry.end:.2f} m")]
    rows += [("known", f"{100 * entry.known_share:.1f} % of {entry.points} points")]
    spreads = entry.standard_deviations.items()
    rows += [(f"standard deviation in {band}", f"{1e3 * one:.3f} mm") for band, one in spreads]
    rows += [(f"defects, {action}", str(count)) for action, count in entry.defects.items()]
    rows += [(name, str(value)) for name, value in asdict(entry.origin).items()]
    rows += [
        (name, f"{one.size} B, SHA-256 {one.sha256[:16]}...") for name, one in entry.files.items()
    ]
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        show.say(f"{name:<{width}}  {_visible(value)}")
    show.note([f"{note}." for note in entry.notes])


@app.command()
def export(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE", help=".nc, .csv or .parquet.")
    ],
    at: At,
    which: Annotated[
        str | None, typer.Option("--entry", metavar="ENTRY", help="Only that pass.")
    ] = None,
    table: Annotated[
        list[str] | None,
        typer.Option(
            "--table", help="defects, sections, not_assessed, spectra or passes. Repeatable."
        ),
    ] = None,
    line: OfLine = None,
    direction: OfDirection = None,
    first: First = None,
    last: Last = None,
    from_m: From = None,
    to_m: To = None,
    all_versions: AllVersions = False,
    as_json: Json = False,
) -> None:
    """Write a pass's profile to a file; or, with --table, rows of all that --line and so on choose."""
    from trackprofile import store as stores
    from trackprofile.io import format_to_write, write
    from trackprofile.io.result_tables import table_files, write_tables

    if table:
        table_files(output, table)
    else:
        format_to_write("profile", output)
    store = stores.open_store(at)
    narrowed = (line, direction, first, last, from_m, to_m)
    entries = _found(store, *narrowed, all_versions=all_versions or which is not None)
    if which is not None:
        entries = (_named(entries, which),)
    if table:
        made = {
            name: _pass_table(entries) if name == PASSES else stores.read_table(store, entries, name, from_m, to_m)
            for name in table
        }  # fmt: skip
        files = write_tables(made, output)
    else:
        if len(entries) != 1:
            raise DataError(
                f"{len(entries)} passes are chosen, a file holds one profile; give one by --entry."
            )
        files = write(stores.read_profile(store, entries[0], from_m, to_m), output)
    if as_json:
        show.as_one_object({"files": list(map(str, files)), "passes": len(entries)})
        return
    show.say(f"{len(entries)} passes in {', '.join(map(str, files))}.")


@app.command()
def verify(at: At, as_json: Json = False) -> None:
    """Read every byte, and name each file that is not what it was; exits 1 if there is one."""
    from trackprofile import store as stores

    store = stores.open_store(at)
    problems = stores.verify(store)
    if as_json:
        show.as_one_object({"problems": [asdict(one) for one in problems]})
    else:
        for one in problems:
            show.say(f"{one.path}: {one.what}.")
        show.say("Whole." if not problems else f"{len(problems)} problems.")
    if problems:
        raise typer.Exit(1)


@app.command()
def tidy(
    at: At,
    now: Annotated[
        bool, typer.Option("--now", help="Also what is younger than a day: if nobody writes.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Remove what writers that were killed left unfinished, and make the index anew."""
    from trackprofile import store as stores

    older = timedelta(0) if now else stores.ABANDONED_AFTER
    store = stores.open_store(at)
    removed, gathered = stores.clean(store, older), stores.build_index(store)
    if as_json:
        show.as_one_object({"removed": list(removed), "index": gathered})
        return
    for path in removed:
        show.say(path)
    show.say(f"{len(removed)} files removed.")


def _origin(
    profile: xr.Dataset, source: str, found: Assessment, way: ChainageTable, revision: int
) -> Origin:
    """Of a profile in a file: by the recording that it names, else by itself."""
    from trackprofile.contracts import content_digest
    from trackprofile.contracts.identity import RECORDING, RECORDING_FINGERPRINT, digest
    from trackprofile.store import Origin

    own = content_digest(profile)
    return Origin(
        recording=str(profile.attrs.get(RECORDING, own)),
        fingerprint=str(profile.attrs.get(RECORDING_FINGERPRINT, "")),
        source=source,
        vehicle=str(profile.attrs.get("vehicle", "")),
        method=str(profile.attrs.get("method", "")),
        limits=found.limits.name,
        speed=found.speed,
        settings=digest(
            {"profile": own, "limits": found.limits, "filter": found.filter, "chainage": way}
        )[:16],
        revision=revision,
    )


def _found(
    store: Store,
    line: str | None,
    direction: str | None,
    first: str | None,
    last: str | None,
    from_m: float | None,
    to_m: float | None,
    *,
    all_versions: bool,
) -> tuple[Entry, ...]:
    from trackprofile.store import find

    return find(
        store, line=line, direction=direction, first=None if first is None else day_of(first),
        last=None if last is None else day_of(last), start=from_m, end=to_m, all_versions=all_versions,
    )  # fmt: skip


def _one(store: Store, which: str) -> Entry:
    from trackprofile.store import find

    return _named(find(store, all_versions=True), which)


def _named(entries: tuple[Entry, ...], which: str) -> Entry:
    """The one entry whose name begins so."""
    found = [one for one in entries if which and one.id.startswith(which)]
    if len(found) != 1:
        raise DataError(
            f"{which!r}: expected the name of one pass or how it begins, found {len(found)}; "
            "see trackprofile store list."
        )
    return found[0]


def _list(entries: tuple[Entry, ...], *, as_json: bool) -> None:
    if as_json:
        show.as_one_object({"passes": [_as_dict(one) for one in entries]})
        return
    show.table(
        ("entry", "line", "direction", "day", "run", "from, m", "to, m", "vehicle", "defects"),
        [
            (one.id, _visible(one.line), _visible(one.direction), one.day.isoformat(), _visible(one.run),
             f"{one.start:.0f}", f"{one.end:.0f}", _visible(one.origin.vehicle), str(sum(one.defects.values())))
            for one in entries
        ],
    )  # fmt: skip


def _as_dict(entry: Entry) -> dict[str, Any]:
    said = asdict(entry)
    said["key"]["day"] = entry.day.isoformat()
    return said


def _pass_table(entries: tuple[Entry, ...]) -> dict[str, list[Any]]:
    """A row of plain columns per pass."""
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


def _visible(name: str) -> str:
    """A name without signs that would move what a terminal shows."""
    return "".join(one if one.isprintable() else f"\\u{ord(one):04x}" for one in name)
