"""The manual is true: its examples run and print what it shows, the names in it exist.

See `manual_examples` for how examples are written; `python tests/refresh_manual.py` writes the
outputs anew.
"""

from __future__ import annotations

import ast
import re
import shlex
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import pytest
import typer

from manual_examples import HOKURIKU, PAGES, PROJECT, Step, name_of, run_page, steps
from refresh_manual import refreshed_output
from trackprofile.cli import app

COMMANDS = typer.main.get_command(app)
OTHER_PROGRAMS = {"--nthreads", "--scheduler-file", "--no-sandbox"}
"""Options in the manual's text that are not this program's."""

every_page = pytest.mark.parametrize("page", PAGES, ids=name_of)


@pytest.mark.acceptance
@every_page
def test_examples_print_the_shown_output(
    page: Path, tmp_path: Path, shared: Callable[[str], Path]
) -> None:
    if page.parent == HOKURIKU:
        shutil.copytree(HOKURIKU, tmp_path, dirs_exist_ok=True)
        (tmp_path / "section_a.csv").symlink_to(shared("data/hokuriku/section_a.csv").resolve())
    for result in run_page(page, tmp_path):
        where = f"{name_of(page)}, line {result.step.line}: {result.step.source}"
        assert result.agrees, f"{where}\n{result.problem}\nprints\n{result.printed}"


@every_page
def test_every_output_belongs_to_an_example(page: Path) -> None:
    # A shell block under another name would not be run.
    text = page.read_text(encoding="utf-8")
    prompts = len(re.findall(r"^\s*\$ ", text, flags=re.MULTILINE))
    commands = [
        step for step in steps(page) if isinstance(step, Step) and step.kind in ("command", "copy")
    ]
    assert prompts == len(commands)
    assert not re.search(r"^\s*```+\s*(sh|bash|shell|zsh)\b", text, re.MULTILINE)


@every_page
def test_options_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for line in _command_lines(text):
        command, options = _parsed(line)
        unknown = options - _options(command)
        assert not unknown, f"{line}: {command.name} has no {', '.join(unknown)}"
    alone = set(re.findall(r"`(--[a-z][a-z-]*)", text)) - OTHER_PROGRAMS
    assert not alone - _all_options(COMMANDS)


@every_page
def test_named_tests_and_modules_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for name, selected in re.findall(
        r"\b(tests/\w+\.py)\b[^`\n]*?(?: -k (\"[^\"]+\"|\w+))?(?=[`\n])", text
    ):
        assert (PROJECT / name).exists(), name
        source = (PROJECT / name).read_text(encoding="utf-8")
        for word in set(selected.strip('"').split()) - {"", "or", "and", "not"}:
            assert re.search(rf"def \w*{word}|\b{word}\b", source), f"{name} -k {word}"
    for name in sorted(set(re.findall(r"`[~(]?(trackprofile(?:\.\w+)+)[`(]", text))):
        resolve_name(name)


def test_quoted_messages_exist() -> None:
    text = (PROJECT / "docs" / "errors.md").read_text(encoding="utf-8")
    quoted = re.findall(r"^(?:- )?(`.+?`)(?=:|, `|$)", text, re.MULTILINE)
    messages = _messages()
    assert len(quoted) > 10
    for message in quoted:
        for part in filter(None, map(str.strip, message.strip("`").split("..."))):
            words = [rf"(?:{re.escape(word)}|\S*\0\S*)" for word in part.split()]
            assert re.search(r"\s+".join(words), messages), part


def _messages() -> str:
    """All texts in the source, a line each, in which a zero stands for a value to be filled in."""
    texts = []
    for path in (PROJECT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.JoinedStr):
                values = (
                    one.value if isinstance(one, ast.Constant) else "\0" for one in node.values
                )
                texts.append("".join(map(str, values)))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                texts.append(node.value)
    return "\n".join(text.replace("\n", " ") for text in texts)


def _command_lines(text: str) -> Iterator[str]:
    """The command lines `trackprofile ...` in a page, in blocks and in text."""
    joined = re.sub(r"\\\n\s*", " ", text)
    yield from re.findall(r"(?<=`)trackprofile [a-z][^`]*(?=`)", joined)
    for line in joined.splitlines():
        match = re.match(r"\s*(?:\$ )?(?:.*&& )?(trackprofile [a-z-].*)", line)
        if match and "`" not in line:
            yield match[1]


def _parsed(line: str) -> tuple[Any, set[str]]:
    """The command of a command line, and the options that it is given."""
    words = shlex.split(re.sub(r"[\[\]]", " ", line), comments=True)
    command: Any = COMMANDS
    options = set()
    for word in words[1:]:
        if word in (">", "2>", "&>", "|", "&", "&&", ";", "2>&1"):
            break
        if word.startswith("-") and not re.fullmatch(r"-?-?\d.*|-", word):
            options.add(word.split("=")[0])
        elif hasattr(command, "commands"):
            assert word in command.commands, f"{line}: there is no command {word!r}"
            command = command.commands[word]
    return command, options


def _options(command: Any) -> set[str]:
    """The options of a command."""
    names = {name for option in command.params for name in (*option.opts, *option.secondary_opts)}
    return names | {"--help"}


def _all_options(command: Any) -> set[str]:
    """The options of a command and of all commands below it."""
    below = getattr(command, "commands", {}).values()
    return _options(command).union(*map(_all_options, below))


@pytest.mark.parametrize(
    ("shown", "printed", "refreshed"),
    [
        ("D1  0.11\nD2  0.20\n", "D1  0.12\nD2  0.20\n", "D1  0.12\nD2  0.20\n"),
        ("a 0.012...,4\n", "a 0.0134567,4\n", "a 0.013...,4\n"),
        ("Stored as ..., 3 files.\n", "Stored as xyz, 4 files.\n", "Stored as ..., 4 files.\n"),
        ("one 1\n...\nlast 2\n", "one 7\nb\nc\nlast 3\n", "one 7\n...\nlast 3\n"),
        ("kept ...\ngone\n", "new line\nkept xyz\n", "new line\nkept ...\n"),
        ("old\n", "new\n", "new\n"),
    ],
)
def test_refreshing_keeps_what_was_left_out(shown: str, printed: str, refreshed: str) -> None:
    assert refreshed_output(shown, printed) == refreshed
