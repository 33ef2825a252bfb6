"""`trackprofile compare`: agreement of a profile with a reference."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackprofile.cli import show
from trackprofile.cli.options import ForwardBackward, From, Json, RailName, To, read_as

if TYPE_CHECKING:
    import xarray as xr


def compare(
    profile: Annotated[
        Path,
        typer.Argument(metavar="PROFILE", help="Profile to evaluate: .nc, .csv or .parquet."),
    ],
    reference: Annotated[
        Path,
        typer.Argument(metavar="REFERENCE", help="Profile to compare with: .nc, .csv or .parquet."),
    ],
    from_m: From = None,
    to_m: To = None,
    forward_backward: ForwardBackward = False,
    rail: Annotated[
        RailName | None,
        typer.Option(
            help="Rail to compare in profiles with separate rails. Default: the mean of both."
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Compare a profile with a reference per wavelength band: correlation, RMS error, gain, lag and coverage."""
    from trackprofile.assessment.compare import compare as compare_profiles

    pair, notes = _select_rail(
        read_as(profile, "profile"), read_as(reference, "profile"), rail or RailName.MEAN
    )
    result = compare_profiles(*pair, from_m=from_m, to_m=to_m, forward_backward=forward_backward)
    show.note((*notes, *result.notes))
    if as_json:
        show.as_one_object(result.as_dict())
        return
    show.comparison(result)


def _select_rail(
    profile: xr.Dataset, reference: xr.Dataset, name: RailName
) -> tuple[tuple[xr.Dataset, xr.Dataset], tuple[str, ...]]:
    """One rail of both profiles, and a note if the reference does not distinguish rails."""
    from trackprofile.contracts import Rail, available_rails, select_rail

    rail = Rail(name)
    selected = select_rail(profile, rail)
    if rail in available_rails(reference):
        return (selected, select_rail(reference, rail)), ()
    return (selected, reference), (
        f"The reference has no separate rails: its elevation is used as that of the {rail}",
    )
