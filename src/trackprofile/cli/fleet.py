"""`trackprofile fleet`: the recordings of a night into a store."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trackprofile.cli import show
from trackprofile.cli.infer import INTERRUPTED_EXIT
from trackprofile.cli.options import Json
from trackprofile.errors import FileError

if TYPE_CHECKING:
    from trackprofile.fleet.batch import BatchProgress, BatchResult, ProgressCallback

PAGE = ".html"
BETWEEN_LINES = 60.0
"""s between lines that say how far it is, where nobody looks at bars."""

NAMED = 5
"""Failed recordings that are named in the end; all are in the page."""


def fleet(
    manifest: Annotated[Path, typer.Argument(metavar="MANIFEST", help=".toml or .csv.")],
    store: Annotated[
        str, typer.Option("--store", metavar="S", help="A folder or URL; made if it is not there.")
    ],
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Of a Dask scheduler, or its file (.json)."),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Processes of this machine; one per core, without --scheduler."),
    ] = None,
    memory: Annotated[
        str, typer.Option(metavar="SIZE", help='That a process here may take, such as "2 GB".')
    ] = "auto",
    retries: Annotated[
        int, typer.Option(min=0, help="After a worker died, or for a reason that is not known.")
    ] = 3,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "-o", "--output", metavar="FILE",
            help=".html, .csv or .parquet. Repeatable; else MANIFEST's name with -fleet.html.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:  # fmt: skip
    """Read, infer, assess and store each recording of a manifest, on the cores here or on a Dask cluster.

    What the store has is not computed again: the same command goes on after whatever stopped it. A recording that
    fails is a row with its reason.
    """
    from trackprofile.fleet.batch import run_batch
    from trackprofile.fleet.cluster import existing, local
    from trackprofile.fleet.conflicts import check_conflicts
    from trackprofile.fleet.manifest import read_manifest
    from trackprofile.store import build_index, clean, create

    if scheduler is not None and (workers is not None or memory != "auto"):
        raise FileError(
            "--workers and --memory are of this machine; with --scheduler its workers have their own."
        )
    files = output or [manifest.with_name(f"{manifest.stem}-fleet{PAGE}")]
    _check_files(files)
    rows = read_manifest(manifest)
    check_conflicts(rows)
    cluster = local(workers, memory, retries) if scheduler is None else existing(scheduler)
    try:
        with show.progress_bars() as bars, cluster as client:
            place = create(store if "://" in store else str(Path(store).absolute()))
            done = run_batch(rows, place, client, retries, _telling(bars))
    except KeyboardInterrupt:
        show.note(["Interrupted: what is in the store stays, and the same command goes on."])
        raise typer.Exit(INTERRUPTED_EXIT) from None
    _tell(done, _write(done, manifest, files), as_json)
    clean(place)
    build_index(place)
    if not any(one.entry for one in done.outcomes):
        raise typer.Exit(1)


def _check_files(files: list[Path]) -> None:
    """See that the results can be written, before a night of work."""
    from trackprofile.fleet.batch_tables import TABLES
    from trackprofile.io.atomic import check_writable
    from trackprofile.io.result_tables import table_files

    for path in files:
        if path.suffix.lower() == PAGE:
            check_writable(path)
        else:
            table_files(path, TABLES)


def _write(done: BatchResult, manifest: Path, files: list[Path]) -> list[Path]:
    from trackprofile.fleet.batch_html import html
    from trackprofile.fleet.batch_tables import TABLES, recordings
    from trackprofile.io.atomic import whole_files
    from trackprofile.io.result_tables import write_tables

    written: list[Path] = []
    for path in files:
        if path.suffix.lower() == PAGE:
            with whole_files(path) as (part,):
                part.write_text(html(done, manifest.name), encoding="utf-8")
            written.append(path)
        else:
            written += write_tables(dict.fromkeys(TABLES, recordings(done)), path)
    return written


def _tell(done: BatchResult, written: list[Path], as_json: bool) -> None:
    from trackprofile.fleet.batch_tables import recordings, sentences
    from trackprofile.fleet.job import State

    said, failed = sentences(done), done.of(State.FAILED)
    if as_json:
        about: dict[str, Any] = {"files": list(map(str, written)), "summary": said}
        about |= {state.name.lower(): len(done.of(state)) for state in State}
        about |= {
            "wall_s": done.wall,
            "cpu_s": done.cpu,
            "workers": done.workers,
            "length_m": done.length,
        }
        show.as_one_object(about | {"recordings": recordings(done)})
        return
    show.note(
        [f"Recording {one.row.number}, {one.row.file.name}: {one.reason}" for one in failed[:NAMED]]
    )
    if len(failed) > NAMED:
        show.note([f"... and {len(failed) - NAMED} more, see {written[0]}."])
    for sentence in said:
        show.say(sentence)
    show.say(f"See {', '.join(map(str, written))}.")


def _telling(bars: Callable[[str, float], None] | None) -> ProgressCallback:
    """How far the night is: a bar where somebody looks, else a line now and then."""
    from trackprofile.fleet.batch_tables import standing

    last = time.monotonic()

    def tell(now: BatchProgress) -> None:
        nonlocal last
        if bars is not None:
            bars("recordings", now.ended / now.total)
        elif time.monotonic() - last >= BETWEEN_LINES:
            last = time.monotonic()
            show.note([standing(now)])

    return tell
