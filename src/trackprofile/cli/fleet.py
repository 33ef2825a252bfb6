"""`trackprofile fleet`: all recordings of a manifest into a store."""

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

HTML = ".html"
PROGRESS_INTERVAL = 60.0
"""s between progress messages where no progress bar is shown."""

MAX_NAMED = 5
"""Maximum number of failed recordings that are printed; the output file lists all."""


def fleet(
    manifest: Annotated[
        Path,
        typer.Argument(
            metavar="MANIFEST",
            help="List of recordings with line, direction, date and models: .toml or .csv.",
        ),
    ],
    store: Annotated[
        str,
        typer.Option(
            "--store",
            metavar="STORE",
            help="Store for the results: a folder, or a URL such as s3://bucket/passes. It is created if it does not "
            "exist.",
        ),
    ],
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Run on the workers of this Dask scheduler: its address, such as tcp://10.0.0.5:8786, or its "
            "scheduler file (.json). Default: worker processes on this machine.",
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Number of worker processes on this machine; not with --scheduler. Default: one per core.",
        ),
    ] = None,
    memory: Annotated[
        str,
        typer.Option(
            metavar="SIZE",
            help='Memory limit of each worker process on this machine, such as "2 GB"; a worker that exceeds it is '
            "restarted. auto is an equal share of the memory.",
        ),
    ] = "auto",
    retries: Annotated[
        int,
        typer.Option(
            min=0,
            metavar="N",
            help="How often a recording is tried again after its worker died or an unexpected error occurred.",
        ),
    ] = 3,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "-o", "--output", metavar="FILE",
            help="File for the list of recordings and their states: .html, .csv or .parquet. Repeatable. Default: the "
            "manifest's name with -fleet.html.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:  # fmt: skip
    """Infer, assess and store each recording of a manifest, on the cores of this machine or on a Dask cluster.

    Recordings that are already in the store are skipped: after an interruption, the same command continues.
    A recording that fails does not stop the others; it is listed with the reason.
    """
    from trackprofile.fleet.batch import run_batch
    from trackprofile.fleet.cluster import existing, local
    from trackprofile.fleet.conflicts import check_conflicts
    from trackprofile.fleet.manifest import read_manifest
    from trackprofile.store import build_index, clean, create

    if scheduler is not None and (workers is not None or memory != "auto"):
        raise FileError(
            "--workers and --memory apply to worker processes on this machine; leave them out with --scheduler."
        )
    files = output or [manifest.with_name(f"{manifest.stem}-fleet{HTML}")]
    _check_files(files)
    rows = read_manifest(manifest)
    check_conflicts(rows)
    cluster = local(workers, memory, retries) if scheduler is None else existing(scheduler)
    try:
        with show.progress_bars() as bars, cluster as client:
            opened = create(store if "://" in store else str(Path(store).absolute()))
            batch = run_batch(rows, opened, client, retries, _progress(bars))
    except KeyboardInterrupt:
        show.error(
            "Interrupted; results in the store are kept, and the same command continues.",
            as_json=as_json,
        )
        raise typer.Exit(INTERRUPTED_EXIT) from None
    _print(batch, _write(batch, manifest, files), as_json=as_json)
    clean(opened)
    build_index(opened)
    if not any(one.entry for one in batch.outcomes):
        raise typer.Exit(1)


def _check_files(files: list[Path]) -> None:
    """Check that the results can be written before the recordings are processed."""
    from trackprofile.fleet.batch_tables import BATCH_TABLES
    from trackprofile.io.atomic import check_writable
    from trackprofile.io.result_tables import table_files

    for path in files:
        if path.suffix.lower() == HTML:
            check_writable(path)
        else:
            table_files(path, BATCH_TABLES)


def _write(batch: BatchResult, manifest: Path, files: list[Path]) -> list[Path]:
    from trackprofile.fleet.batch_html import html
    from trackprofile.fleet.batch_tables import BATCH_TABLES, recordings
    from trackprofile.io.atomic import whole_files
    from trackprofile.io.result_tables import write_tables

    written: list[Path] = []
    for path in files:
        if path.suffix.lower() == HTML:
            with whole_files(path) as (part,):
                part.write_text(html(batch, manifest.name), encoding="utf-8")
            written.append(path)
        else:
            written += write_tables(dict.fromkeys(BATCH_TABLES, recordings(batch)), path)
    return written


def _print(batch: BatchResult, written: list[Path], *, as_json: bool) -> None:
    from trackprofile.fleet.batch_tables import recordings, sentences
    from trackprofile.fleet.job import State

    summary, failed = sentences(batch), batch.of(State.FAILED)
    if as_json:
        about: dict[str, Any] = {"files": list(map(str, written)), "summary": summary}
        about |= {state.name.lower(): len(batch.of(state)) for state in State}
        about |= {
            "wall_s": batch.wall,
            "cpu_s": batch.cpu,
            "workers": batch.workers,
            "length_m": batch.length,
        }
        show.as_one_object(about | {"recordings": recordings(batch)})
        return
    show.note(
        [
            f"Recording {one.row.number}, {one.row.file.name}: {one.reason}"
            for one in failed[:MAX_NAMED]
        ]
    )
    if len(failed) > MAX_NAMED:
        show.note([f"... and {len(failed) - MAX_NAMED} more, see {written[0]}."])
    for sentence in summary:
        show.say(sentence)
    show.say(f"List of recordings in {', '.join(map(str, written))}.")


def _progress(bars: Callable[[str, float], None] | None) -> ProgressCallback:
    """Report the progress: a bar in a terminal, else a message every `PROGRESS_INTERVAL`."""
    from trackprofile.fleet.batch_tables import describe_progress

    last = time.monotonic()

    def report(progress: BatchProgress) -> None:
        nonlocal last
        if bars is not None:
            bars("recordings", progress.ended / progress.total)
        elif time.monotonic() - last >= PROGRESS_INTERVAL:
            last = time.monotonic()
            show.note([describe_progress(progress)])

    return report
