"""The manual's examples: found in a page, run in order, compared with what the page shows.

In a page, in the order in which they stand,

- a block ``console`` holds commands after ``$ `` and, below each, the output that the page shows;
- a block ``{doctest}`` holds Python after ``>>> `` and the output that the page shows;
- a block ``python`` is run in the same interpreter;
- a block ``{code-block}`` whose caption is a file name is written to that file.

``...`` in a shown output stands for any text. A directive above a block, ``% text`` in the manual or
``<!-- text -->`` elsewhere, changes how the block is run:

- ``exits N``: the exit code of the block's last command, if it is not 0;
- ``timings``: the numbers depend on the machine, only the text between them is compared;
- ``as in PAGE``: the output is the one that PAGE shows for the same command, nothing is run;
- ``not run``: the block is an illustration.
"""

from __future__ import annotations

import contextlib
import doctest
import io
import os
import re
import subprocess
import sys
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markdown_it import MarkdownIt

PROJECT = Path(__file__).parent.parent
MANUAL = PROJECT / "docs"
HOKURIKU = PROJECT / "examples" / "hokuriku"
PAGES = sorted(
    path
    for path in (*MANUAL.rglob("*.md"), PROJECT / "README.md", HOKURIKU / "README.md")
    if "_build" not in path.parts
)

LONGEST_COMMAND = 600.0
"""Time limit of one command, s."""


@dataclass(frozen=True)
class File:
    """A file to be written before the steps that follow."""

    name: str
    text: str


@dataclass(frozen=True)
class Step:
    """Something to be run.

    Parameters
    ----------
    kind : "command", "python", or "copy" where the output is that of another page
    line : in the page, counted from 1
    source : command line or Python source; of a copy the command line
    shown : output that the page shows, or None where it shows none
    rows : range of the page's lines that ``shown`` occupies, counted from 0
    code : expected exit code of a command
    timings : whether the numbers of the output depend on the machine
    page : of a copy, the page whose output it is
    """

    kind: str
    line: int
    source: str
    shown: str | None
    rows: tuple[int, int]
    code: int = 0
    timings: bool = False
    page: Path | None = None


@dataclass(frozen=True)
class Result:
    """What a step printed; ``problem`` is a sentence where it did not end as expected."""

    step: Step
    printed: str
    problem: str = ""

    @property
    def agrees(self) -> bool:
        """Whether the step ended as expected and printed the output that the page shows."""
        shown = self.step.shown
        if self.problem:
            return False
        return shown is None or matches(shown, self.printed, ignore_numbers=self.step.timings)


def name_of(page: Path) -> str:
    """Path of a page relative to the project."""
    return page.relative_to(PROJECT).as_posix()


def steps(page: Path) -> Iterator[File | Step]:
    """The files and steps of a page, in order."""
    directives: list[str] = []
    for token in MarkdownIt().parse(page.read_text(encoding="utf-8")):
        if token.type in ("inline", "html_block"):
            directives = _directives(token.content)
        elif token.type == "fence":
            first = token.map[0] + 1 if token.map else 0
            yield from _block_steps(token.info.strip(), token.content, first, directives)
            directives = []


def _directives(text: str) -> list[str]:
    """The directives in a comment of a page; empty for other text."""
    lines = [
        re.fullmatch(r"%\s*(.+)|<!--\s*(.+?)\s*-->", line.strip()) for line in text.splitlines()
    ]
    return [match[1] or match[2] for match in lines if match]


def _block_steps(info: str, text: str, first: int, directives: list[str]) -> Iterator[File | Step]:
    """The steps of a fenced block whose text starts at the page's line ``first``, from 0."""
    if "not run" in directives:
        return
    caption = re.match(r":caption: (\S+)\n\n", text)
    if info == "console":
        yield from _commands(text, first, directives)
    elif info == "{doctest}" or (info == "python" and text.startswith(">>> ")):
        yield from _python_examples(text, first)
    elif info == "python":
        yield Step("python", first + 1, text, None, (0, 0))
    elif caption:
        yield File(caption[1], text[caption.end() :])


def _commands(text: str, first: int, directives: list[str]) -> Iterator[Step]:
    """The commands of a console block."""
    code = next((int(one[6:]) for one in directives if re.fullmatch(r"exits \d+", one)), 0)
    page = next((PROJECT / one[6:] for one in directives if one.startswith("as in ")), None)
    start, *parts = re.split(r"^\$ ", text, flags=re.MULTILINE)
    assert not start, f"line {first + 1}: a console block begins with a command"
    row = first
    for number, part in enumerate(parts, start=1):
        # A backslash at the end of a line continues the command.
        match = re.match(r"((?:.*\\\n)*.*)\n?", part)
        assert match is not None
        shown, end = part[match.end() :], row + part.count("\n")
        yield Step(
            "copy" if page else "command", row + 1, match[1], shown or None,
            (row + match[0].count("\n"), end), code if number == len(parts) else 0,
            "timings" in directives, page,
        )  # fmt: skip
        row = end


def _python_examples(text: str, first: int) -> Iterator[Step]:
    """The examples of a doctest block."""
    for example in doctest.DocTestParser().get_examples(text):
        start = first + example.lineno + example.source.count("\n")
        rows = start, start + example.want.count("\n")
        yield Step("python", first + example.lineno + 1, example.source, example.want, rows)


def run_page(page: Path, folder: Path, *, timings: bool = True) -> Iterator[Result]:
    """Run the steps of a page in a folder, one result for each step.

    Python runs in this process, with ``folder`` as the working directory. Without ``timings``, steps
    whose numbers depend on the machine are passed over.
    """
    names: dict[str, Any] = {"__name__": "__main__"}
    for step in steps(page):
        if isinstance(step, Step) and step.timings and not timings:
            continue
        if isinstance(step, File):
            (folder / step.name).write_text(step.text, encoding="utf-8")
        elif step.kind == "command":
            yield _run_command(step, folder)
        elif step.kind == "python":
            yield _run_python(step, folder, names)
        else:
            yield _copy(step)


def _run_command(step: Step, folder: Path) -> Result:
    """Run a command in a shell in which this Python's commands come first."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    try:
        done = subprocess.run(
            ["bash", "-c", step.source], cwd=folder, env=os.environ | {"PATH": path}, timeout=LONGEST_COMMAND,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8", check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return Result(step, "", f"takes more than {LONGEST_COMMAND:g} s")
    wrong = done.returncode != step.code
    problem = f"exits with {done.returncode}, expected {step.code}" if wrong else ""
    return Result(step, done.stdout, problem)


def _run_python(step: Step, folder: Path, names: dict[str, Any]) -> Result:
    """Run Python source in the page's namespace."""
    # Compiled as at the prompt where an output is expected: an expression prints its value.
    mode = "exec" if step.shown is None else "single"
    printed = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(printed):
        try:
            exec(compile(step.source, f"<line {step.line}>", mode), names)
        except Exception:  # noqa: BLE001 (the example failed, whatever it raised)
            return Result(step, printed.getvalue(), traceback.format_exc())
    return Result(step, printed.getvalue())


def _copy(step: Step) -> Result:
    """The output that another page shows for the same command."""
    assert step.page is not None
    for other in steps(step.page):
        if isinstance(other, Step) and other.source == step.source and other.shown is not None:
            return Result(step, other.shown)
    return Result(step, "", f"{name_of(step.page)} does not show this command")


NUMBER = r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?"


def matches(shown: str, printed: str, *, ignore_numbers: bool = False) -> bool:
    """Whether a printed output is the shown one, apart from space at the ends of lines.

    >>> matches("a ... c\\n...\\nz", "a b c  \\nd\\ne\\nz")
    True
    >>> matches("a", "a\\nb")
    False
    >>> matches("run_s  0.9 s", "run_s  12.3 s", ignore_numbers=True)
    True
    """
    shown, printed = trimmed(shown), trimmed(printed)
    if ignore_numbers:
        shown, printed = (re.sub(rf" +{NUMBER}", " 0", text) for text in (shown, printed))
    pattern = re.escape(shown).replace(re.escape("..."), ".*")
    return re.fullmatch(pattern, printed, re.DOTALL) is not None


def trimmed(text: str) -> str:
    """A text without space at the ends of lines, and without empty lines at the end."""
    return "\n".join(line.rstrip() for line in text.splitlines()).rstrip()
