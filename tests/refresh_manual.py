"""Run the manual's examples and rewrite the outputs that the pages show.

    python tests/refresh_manual.py                     # all pages, one process for each processor
    python tests/refresh_manual.py docs/rails.md ...   # these pages
    python tests/refresh_manual.py --check             # list what differs, write nothing
    python tests/refresh_manual.py --timings README.md # also the figures of this machine's speed

An output that agrees stays as it is. Where a shown output leaves something out (``...``), the new one
does too, as far as their lines correspond. A command that fails is reported and its output stays.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

from manual_examples import (
    HOKURIKU,
    NUMBER,
    PAGES,
    PROJECT,
    Result,
    Step,
    matches,
    name_of,
    run_page,
    steps,
)

DATA = PROJECT.parent / "shared" / "data" / "hokuriku" / "section_a.csv"


@dataclass(frozen=True)
class Settings:
    """Options of the command line.

    Parameters
    ----------
    check : whether only to list what differs
    timings : whether to run the examples whose numbers depend on the machine, too
    data : section_a.csv, which the page of the real recording needs
    """

    check: bool
    timings: bool
    data: Path


def main(arguments: Sequence[str] | None = None) -> int:
    """Refresh pages; the exit code is 1 where an example failed or, with --check, differs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("pages", nargs="*", type=Path, help="pages (default: all)")
    parser.add_argument("--check", action="store_true", help="list what differs, write nothing")
    parser.add_argument("--timings", action="store_true", help="also measure this machine's speed")
    parser.add_argument(
        "--data", type=Path, default=DATA, help="section_a.csv of examples/hokuriku"
    )
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args(arguments)
    settings = Settings(options.check, options.timings, options.data)
    pages = [page.resolve() for page in options.pages] or PAGES
    # Pages that copy an output of another page come last, the longest of the others first.
    copying = [page for page in pages if any(step.kind == "copy" for step in _steps(page))]
    others = sorted(set(pages) - set(copying), key=lambda page: -len(_steps(page)))
    clean = True
    with ProcessPoolExecutor(options.processes, mp_context=get_context("spawn")) as pool:
        for message in pool.map(partial(refresh_page, settings=settings), others):
            clean &= _reported(message)
    for page in copying:
        clean &= _reported(refresh_page(page, settings))
    return 0 if clean else 1


def _reported(message: tuple[str, bool]) -> bool:
    """Print what was done with a page, and say whether it is clean."""
    text, clean = message
    print(text, flush=True)  # noqa: T201
    return clean


def _steps(page: Path) -> list[Step]:
    return [step for step in steps(page) if isinstance(step, Step)]


def refresh_page(page: Path, settings: Settings) -> tuple[str, bool]:
    """Run a page's examples and rewrite its outputs; what was done, and whether it is clean."""
    if page.parent == HOKURIKU and not settings.data.exists():
        return f"{name_of(page)}: skipped, {settings.data} does not exist", True
    with TemporaryDirectory() as folder:
        if page.parent == HOKURIKU:
            shutil.copytree(HOKURIKU, folder, dirs_exist_ok=True)
            (Path(folder) / "section_a.csv").symlink_to(settings.data.resolve())
        results = [*run_page(page, Path(folder), timings=settings.timings)]
    failed = [result for result in results if result.problem]
    differing = [
        result for result in results if not result.problem and _differs(result, settings.timings)
    ]
    if not settings.check:
        _rewrite(page, differing)
    lines = [
        *(f"  line {one.step.line}: {one.problem}\n{one.printed}" for one in failed),
        *(f"  line {one.step.line}: {_verb(settings)}: {one.step.source}" for one in differing),
    ]
    summary = f"{name_of(page)}: {len(results)} run, {len(failed)} failed, {len(differing)} differ"
    return "\n".join([summary, *lines]), not failed and not (settings.check and differing)


def _verb(settings: Settings) -> str:
    return "differs" if settings.check else "rewritten"


def _differs(result: Result, timings: bool) -> bool:
    """Whether the page shows another output; of timings, other numbers count on request only."""
    if result.step.timings and timings:
        return not matches(result.step.shown or "", result.printed)
    return not result.agrees


def _rewrite(page: Path, results: Sequence[Result]) -> None:
    """Replace the outputs of a page, from the last to the first so that line numbers hold."""
    lines = page.read_text(encoding="utf-8").splitlines(keepends=True)
    for result in sorted(results, key=lambda one: -one.step.line):
        start, stop = result.step.rows
        lines[start:stop] = [refreshed_output(result.step.shown or "", result.printed)]
    page.write_text("".join(lines), encoding="utf-8")


def refreshed_output(shown: str, printed: str) -> str:
    """A printed output, shortened by ``...`` where the shown one is."""
    old = [line.rstrip() for line in shown.splitlines()]
    new = [line.rstrip() for line in printed.splitlines()]
    result = "\n".join(_merged(old, new)).rstrip() + "\n"
    return result if matches(result, printed) else "\n".join(new).rstrip() + "\n"


def _merged(old: list[str], new: list[str]) -> Iterator[str]:
    """Lines of ``new``, in the form of those lines of ``old`` that correspond to them."""
    if not old:
        yield from new
    elif old[0] == "...":
        following = _position(old[1], new) if len(old) > 1 else None
        yield "..."
        yield from _merged(old[1:], [] if following is None else new[following:])
    else:
        position = _position(old[0], new)
        if position is None or any(_position(line, new[:position]) is not None for line in old[1:]):
            yield from _merged(old[1:], new)
        else:
            yield from new[:position]
            yield _shortened(old[0], new[position]) or new[position]
            yield from _merged(old[1:], new[position + 1 :])


def _position(line: str, new: list[str]) -> int | None:
    """Index of the first new line that corresponds to a shown one."""
    indices = (index for index, other in enumerate(new) if _shortened(line, other) is not None)
    return next(indices, None)


def _shortened(line: str, new: str) -> str | None:
    """A new line, left out where the shown line is; None if they differ in more than numbers."""
    pieces = re.split(rf"(\.\.\.|{NUMBER}| +)", line)
    pattern = ""
    for index, piece in enumerate(pieces):
        if piece == "...":
            pattern += ".*?"
        elif re.fullmatch(NUMBER, piece):
            cut = pieces[index + 1 : index + 3] == ["", "..."]
            digits = len(piece.partition(".")[2])
            pattern += rf"(-?\d+\.\d{{{digits}}})" if cut and digits else f"({NUMBER})"
        elif piece.isspace():
            pattern += "( +)"
        else:
            pattern += re.escape(piece)
    match = re.fullmatch(pattern, new)
    if match is None:
        return None
    values = iter(match.groups())
    varying = re.compile(rf"{NUMBER}| +")
    return "".join(next(values) if varying.fullmatch(piece) else piece for piece in pieces)


if __name__ == "__main__":
    sys.exit(main())
