"""Wrong usage: a message that suggests the nearest command or option."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import typer
from typer.core import TyperCommand, TyperGroup

if TYPE_CHECKING:

    class UsageError(Exception):
        """Wrong usage of a command."""

        ctx: Any

        def format_message(self) -> str: ...
else:
    # Typer exports the base class of its errors under no public name.
    UsageError = typer.BadParameter.__mro__[2]

RENAMED_COMMANDS = {"limit": "accuracy", "changes": "trend", "tidy": "clean"}
"""Earlier names of commands: suggested, but not accepted."""

RENAMED_OPTIONS = {
    "--anyway": "--keep-undetermined",
    "--beside": "--compare-with",
    "--correct": "--full-track-correction",
    "--day": "--date",
    "--draws": "--samples",
    "--earlier": "--previous",
    "--first": "--first-date",
    "--hours": "--working-hours",
    "--km": "--length",
    "--last": "--last-date",
    "--load": "--estimate-load",
    "--name": "--hostname",
    "--passes": "--forward-backward",
    "--picture": "--figure",
    "--raw-days": "--retention-days",
    "--recording-km": "--recording-length",
    "--sampling": "--sampling-rate",
    "--way": "--chainage",
}
"""Earlier names of options: suggested, but not accepted."""


def nearest(typed: str, names: Iterable[str], renamed: Mapping[str, str]) -> list[str]:
    """The names that a mistyped, abbreviated or earlier name may stand for, the most similar first.

    Examples
    --------
    >>> nearest("--draw", ["--samples", "--seed"], RENAMED_OPTIONS)
    ['--samples']
    >>> nearest("infre", ["infer", "inspect"], RENAMED_COMMANDS)
    ['infer']
    """
    current = {name: name for name in names}
    candidates = current | {old: new for old, new in renamed.items() if new in current}
    if typed in candidates:
        return [candidates[typed]]
    abbreviated = [name for name in candidates if typed.strip("-") and name.startswith(typed)]
    matches = abbreviated or get_close_matches(typed, candidates)
    return list(dict.fromkeys(candidates[name] for name in matches))


def suggestion(matches: list[str]) -> str:
    """The end of a message about an unknown name."""
    return f"; did you mean {' or '.join(matches)}?" if matches else "."


def usage_message(error: UsageError) -> str:
    """One sentence that states what is wrong with the arguments."""
    unknown = getattr(error, "option_name", None)
    if unknown is None or not hasattr(error, "possibilities"):
        return error.format_message()
    options = [
        name
        for parameter in error.ctx.command.params
        for name in parameter.opts
        if name.startswith("--")
    ]
    return f"{unknown}: no such option{suggestion(nearest(unknown, options, RENAMED_OPTIONS))}"


class Command(TyperCommand):
    """A command whose help shows options without a value as such."""

    def get_help_option(self, ctx: Any) -> Any:
        return _without_value(super().get_help_option(ctx))


class Group(TyperGroup):
    """A group of commands that suggests the nearest command for an unknown one."""

    def get_help_option(self, ctx: Any) -> Any:
        return _without_value(super().get_help_option(ctx))

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        name = args[0]
        if not name.startswith("-") and self.get_command(ctx, name) is None:
            matches = nearest(name, self.list_commands(ctx), RENAMED_COMMANDS)
            ctx.fail(f"{name}: no such command{suggestion(matches)}")
        return super().resolve_command(ctx, args)


def _without_value(option: Any) -> Any:
    if option is not None:
        option.metavar = ""
    return option
