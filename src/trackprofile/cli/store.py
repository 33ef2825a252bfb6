"""`trackprofile store add | list | show | export | verify | clean`: all passes over a network, in one store."""

from __future__ import annotations

from dataclasses import asdict
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackprofile.cli import show
from trackprofile.cli.inputs import (
    ChainageFile,
    LimitsName,
    Profile,
    Speed,
    as_text,
    assess_profile,
    read_chainage_table,
)
from trackprofile.cli.options import (
    FirstDate,
    ForwardBackward,
    From,
    Json,
    LastDate,
    StoreUrl,
    To,
    flag,
    parse_date,
    read_as,
)
from trackprofile.cli.store_entries import (
    entry_as_dict,
    entry_filters,
    find_entries,
    pass_table,
    print_passes,
    select_entry,
    visible,
)
from trackprofile.cli.usage import Command, Group
from trackprofile.errors import DataError

if TYPE_CHECKING:
    import xarray as xr

    from trackprofile.assessment.assess import Assessment
    from trackprofile.positioning.chainage import ChainageTable
    from trackprofile.store import Origin

PASSES = "passes"

app = typer.Typer(
    cls=Group,
    help="Store the profiles and assessments of all passes over a network, in a folder or at a URL.",
    no_args_is_help=True,
)

LineFilter = Annotated[
    str | None,
    typer.Option(
        "--line", metavar="LINE", help="Use only passes over this line. Default: all lines."
    ),
]
DirectionFilter = Annotated[
    str | None,
    typer.Option(
        "--direction",
        metavar="DIRECTION",
        help="Use only passes in this direction. Default: all directions.",
    ),
]
AllVersions = Annotated[
    bool,
    flag(
        "--all-versions",
        "Include all versions of each recording's profile. Default: only the newest.",
    ),
]
EntryName = Annotated[
    str,
    typer.Argument(
        metavar="ENTRY", help="Name of the pass in the store, or the beginning of the name."
    ),
]


@app.command(cls=Command)
def add(
    profile: Profile,
    store: StoreUrl,
    line: Annotated[str, typer.Option(metavar="LINE", help="Name of the line.")],
    direction: Annotated[
        str, typer.Option(metavar="DIRECTION", help="Direction of the run, such as up or down.")
    ],
    day: Annotated[
        str, typer.Option("--date", metavar="DATE", help="Date of the run, such as 2026-05-31.")
    ],
    speed: Speed,
    run: Annotated[
        str,
        typer.Option(
            metavar="RUN",
            help="Identifier of the run among those of the day: its time, or the train's number. Default: none.",
            show_default=False,
        ),
    ] = "",
    limits: LimitsName = "en-13848",
    chainage: ChainageFile = None,
    forward_backward: ForwardBackward = False,
    revision: Annotated[
        int,
        typer.Option(
            min=0,
            metavar="N",
            help="Rank of this version of the recording's profile: of several versions the one with the highest "
            "revision is shown.",
        ),
    ] = 0,
    as_json: Json = False,
) -> None:
    """Assess a profile and store both. A store that does not exist is created; the same pass is stored once."""
    from trackprofile import store as stores
    from trackprofile.assessment.limits import condense_notes
    from trackprofile.units import counted

    key = stores.PassKey(line, direction, parse_date(day), run)
    dataset, table = read_as(profile, "profile"), read_chainage_table(chainage)
    assessment = assess_profile(dataset, limits, speed, forward_backward=forward_backward)
    origin = _origin(dataset, profile.name, assessment, table, revision)
    added = stores.add(stores.create(store), key, dataset, assessment, origin, chainage=table)
    notes = list(assessment.notes)
    if not added.shown:
        notes.append(
            "Another version of this recording remains the one that is shown: see --revision"
        )
    if as_json:
        show.as_one_object(
            {
                "new": added.new,
                "shown": added.shown,
                "notes": notes,
                "entry": entry_as_dict(added.entry),
            }
        )
        return
    show.note_sentences(condense_notes(notes))
    state = "Stored as" if added.new else "Already in the store:"
    size = sum(one.size for one in added.entry.files.values())
    files = counted(len(added.entry.files), "file")
    show.say(f"{state} {added.entry.id}, {size / 1e6:.2f} MB in {files}.")


@app.command("list", cls=Command)
def list_passes(
    store: StoreUrl,
    line: LineFilter = None,
    direction: DirectionFilter = None,
    first_date: FirstDate = None,
    last_date: LastDate = None,
    from_m: From = None,
    to_m: To = None,
    all_versions: AllVersions = False,
    as_json: Json = False,
) -> None:
    """List the lines of a store; with any filter, list the passes that match it."""
    from trackprofile.store import lines, open_store

    opened = open_store(store)
    filters = entry_filters(line, direction, first_date, last_date, from_m, to_m)
    if all_versions or any(one is not None for one in filters.values()):
        print_passes(find_entries(opened, filters, all_versions=all_versions), as_json=as_json)
        return
    stored = lines(opened)
    if as_json:
        show.as_one_object(
            {
                "lines": [
                    asdict(one) | {"days": [each.isoformat() for each in one.days]}
                    for one in stored
                ]
            }
        )
        return
    show.table(
        ("line", "direction", "from, m", "to, m", "passes", "first date", "last date"),
        [
            (visible(one.line), visible(one.direction), f"{one.start:.0f}", f"{one.end:.0f}", str(one.passes),
             one.days[0].isoformat(), one.days[-1].isoformat())
            for one in stored
        ],
    )  # fmt: skip


@app.command("show", cls=Command)
def show_pass(name: EntryName, store: StoreUrl, as_json: Json = False) -> None:
    """Show one pass: line, date, extent, standard deviations, defects, vehicle, method and files."""
    from trackprofile.assessment.limits import condense_notes
    from trackprofile.store import find, open_store

    entry = select_entry(find(open_store(store), all_versions=True), name)
    if as_json:
        show.as_one_object(entry_as_dict(entry))
        return
    rows = [("entry", entry.id), ("line", entry.line), ("direction", entry.direction)]
    rows += [("date", entry.day.isoformat()), ("run", entry.run)]
    rows += [("from, to", f"{entry.start:.2f} m, {entry.end:.2f} m")]
    rows += [("known", f"{100 * entry.known_share:.1f} % of {entry.points} points")]
    rows += [
        (f"standard deviation in {band}", f"{1e3 * value:.3f} mm")
        for band, value in entry.standard_deviations.items()
    ]
    rows += [(f"defects, {action}", str(count)) for action, count in entry.defects.items()]
    rows += [(key, str(value)) for key, value in asdict(entry.origin).items()]
    rows += [
        (file, f"{one.size} B, SHA-256 {one.sha256[:16]}...") for file, one in entry.files.items()
    ]
    width = max(len(head) for head, _ in rows)
    for head, value in rows:
        show.say(f"{head:<{width}}  {visible(value)}")
    show.note_sentences(condense_notes(entry.notes))


@app.command(cls=Command)
def export(
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="File to write to: .nc, .csv or .parquet for a profile; .csv or .parquet for tables, one file per "
            "table, its name is appended.",
        ),
    ],
    store: StoreUrl,
    name: Annotated[
        str | None,
        typer.Option(
            "--entry",
            metavar="ENTRY",
            help="Export only the pass of this name, or whose name begins so. Default: all passes that match the "
            "other filters.",
        ),
    ] = None,
    table: Annotated[
        list[str] | None,
        typer.Option(
            "--table",
            metavar="TABLE",
            help="Export this table of all matching passes in place of a profile: defects, sections, not_assessed, "
            "spectra or passes. Repeatable.",
        ),
    ] = None,
    line: LineFilter = None,
    direction: DirectionFilter = None,
    first_date: FirstDate = None,
    last_date: LastDate = None,
    from_m: From = None,
    to_m: To = None,
    all_versions: AllVersions = False,
    as_json: Json = False,
) -> None:
    """Write the profile of one pass to a file or, with --table, tables of all passes that match the filters."""
    from trackprofile import store as stores
    from trackprofile.io import format_to_write, write
    from trackprofile.io.result_tables import table_files, write_tables
    from trackprofile.units import counted

    if table:
        table_files(output, table)
    else:
        format_to_write("profile", output)
    opened = stores.open_store(store)
    filters = entry_filters(line, direction, first_date, last_date, from_m, to_m)
    entries = find_entries(opened, filters, all_versions=all_versions or name is not None)
    if name is not None:
        entries = (select_entry(entries, name),)
    if table:
        tables = {
            one: pass_table(entries) if one == PASSES else stores.read_table(opened, entries, one, from_m, to_m)
            for one in table
        }  # fmt: skip
        files = write_tables(tables, output)
    else:
        if len(entries) != 1:
            raise DataError(
                f"{counted(len(entries), 'pass')} match the filters, a file holds one profile; select one with --entry."
            )
        files = write(stores.read_profile(opened, entries[0], from_m, to_m), output)
    if as_json:
        show.as_one_object({"files": as_text(files), "passes": len(entries)})
        return
    show.say(f"{counted(len(entries), 'pass')} in {', '.join(as_text(files))}.")


@app.command(cls=Command)
def verify(store: StoreUrl, as_json: Json = False) -> None:
    """Read all files of a store and report each that is missing or damaged; exit code 1 if there is one."""
    from trackprofile import store as stores
    from trackprofile.units import counted

    problems = stores.verify(stores.open_store(store))
    if as_json:
        show.as_one_object({"problems": [asdict(one) for one in problems]})
    else:
        for one in problems:
            show.say(f"{one.path}: {one.what}.")
        show.say(
            f"{counted(len(problems), 'problem')} found." if problems else "No problems found."
        )
    if problems:
        raise typer.Exit(1)


@app.command(cls=Command)
def clean(
    store: StoreUrl,
    now: Annotated[
        bool,
        flag(
            "--now",
            "Remove also unfinished files younger than a day. Use it only while nothing else writes to the store.",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Remove unfinished files of interrupted writers, and rebuild the index."""
    from trackprofile import store as stores
    from trackprofile.units import counted

    minimum_age = timedelta(0) if now else stores.ABANDONED_AFTER
    opened = stores.open_store(store)
    removed, indexed = stores.clean(opened, minimum_age), stores.build_index(opened)
    if as_json:
        show.as_one_object({"removed": list(removed), "index": indexed})
        return
    for path in removed:
        show.say(path)
    show.say(f"{counted(len(removed), 'file')} removed.")


def _origin(
    profile: xr.Dataset, source: str, assessment: Assessment, chainage: ChainageTable, revision: int
) -> Origin:
    """Origin of a profile in a file: identified by the recording that it names, else by its own content."""
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
        limits=assessment.limits.name,
        speed=assessment.speed,
        settings=digest(
            {
                "profile": own,
                "limits": assessment.limits,
                "filter": assessment.filter,
                "chainage": chainage,
            }
        )[:16],
        revision=revision,
    )
