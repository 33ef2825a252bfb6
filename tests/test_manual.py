"""The manual's examples in the shell: each page's, in order, in a folder of its own.

In a page, a block ``console`` holds commands after ``$ `` and, where it shows any, what each prints
on both of its outputs; ``...`` stands for whatever else there is. A comment ``% exits 1`` above the
block says how its last command ends, if not with 0. A block ``{code-block}`` whose caption is a file's
name is put there under that name first.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

MANUAL = Path(__file__).parent.parent / "docs"
PAGES = sorted(path for path in MANUAL.rglob("*.md") if "_build" not in path.parts)

LONGEST = 300.0
"""s that one command may take."""


@dataclass(frozen=True)
class File:
    """To be written before the commands that follow."""

    name: str
    text: str


@dataclass(frozen=True)
class Command:
    """To be run; ``shown`` is what the page says it prints, empty where it says nothing."""

    line: int
    text: str
    shown: str
    code: int


def steps(page: Path) -> Iterator[File | Command]:
    """What a page says to do."""
    code = 0
    for token in MarkdownIt().parse(page.read_text(encoding="utf-8")):
        if token.type == "inline":
            said = re.fullmatch(r"% exits (\d+)", token.content)
            code = int(said[1]) if said else 0
        elif token.type == "fence":
            first = token.map[0] + 2 if token.map else 0
            caption = re.match(r":caption: (\S+)\n\n", token.content)
            if token.info == "console":
                yield from commands(token.content, first, code)
            elif caption:
                yield File(caption[1], token.content[caption.end() :])
            code = 0


def commands(block: str, first: int, code: int) -> Iterator[Command]:
    """The commands of a block that starts at line ``first`` of its page."""
    begin, *following = re.split(r"^\$ ", block, flags=re.MULTILINE)
    assert not begin, f"line {first}: a console block begins with a command"
    line = first
    for number, part in enumerate(following, start=1):
        # A backslash at a line's end carries the command on.
        found = re.match(r"((?:.*\\\n)*.*)\n?", part)
        assert found is not None
        last = number == len(following)
        yield Command(line, found[1], part[found.end() :], code if last else 0)
        line += part.count("\n")


def same(shown: str, printed: str) -> bool:
    """Whether a text is the one that is shown, but for space at the ends of lines.

    >>> same("a ... c\\n...\\nz", "a b c  \\nd\\ne\\nz")
    True
    >>> same("a", "a\\nb")
    False
    """
    patterns, text = re.escape(trimmed(shown)).replace(re.escape("..."), ".*"), trimmed(printed)
    return re.fullmatch(patterns, text, re.DOTALL) is not None


def trimmed(text: str) -> str:
    """Without space at the ends of lines, and without empty lines at the end."""
    return "\n".join(line.rstrip() for line in text.splitlines()).rstrip()


def run(command: Command, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command as a shell with this Python's commands would."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    return subprocess.run(
        ["bash", "-c", command.text], cwd=folder, env=os.environ | {"PATH": path}, timeout=LONGEST,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8", check=False,
    )  # fmt: skip


@pytest.mark.acceptance
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(MANUAL).as_posix())
def test_page(page: Path, tmp_path: Path) -> None:
    for step in steps(page):
        if isinstance(step, File):
            (tmp_path / step.name).write_text(step.text, encoding="utf-8")
            continue
        done, where = run(step, tmp_path), f"{page.name}, line {step.line}: {step.text}"
        assert done.returncode == step.code, f"{where}\nexits {done.returncode}:\n{done.stdout}"
        if step.shown:
            assert same(step.shown, done.stdout), f"{where}\nprints\n{done.stdout}"


def test_no_example_escapes() -> None:
    assert PAGES
    # A shell block by another name would not be run, a prompt would not be seen.
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        prompts = len(re.findall(r"^\s*\$ ", text, flags=re.MULTILINE))
        assert prompts == sum(isinstance(step, Command) for step in steps(page)), page.name
        assert not re.search(r"^\s*```+\s*(sh|bash|shell|zsh)\b", text, re.MULTILINE), page.name
