"""Endpoints at ``/api``: each answers one kind of request about a store."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from trackprofile import __version__
from trackprofile.assessment.limits import KM_H
from trackprofile.bands import BANDS
from trackprofile.contracts.identity import digest
from trackprofile.server import assessment_rows as rows
from trackprofile.server import requests, responses
from trackprofile.server.chart_data import (
    envelope_response,
    merge_passes,
    not_assessed_stretches,
)
from trackprofile.server.data_quality import quality_response
from trackprofile.server.history import band_of, comparison_response, development_response
from trackprofile.server.line_catalogue import LineCatalogue, UnknownError
from trackprofile.store import Entry
from trackprofile.store.layout import ENTRIES

MAX_PASSES = 1000
"""Maximum number of passes in one list: the latest."""

_TAG_DIGITS = 24
_MILLI = 1e3


class NotModifiedError(Exception):
    """The client already has the answer, which its entity tag identifies."""

    def __init__(self, tag: str) -> None:
        super().__init__(tag)
        self.tag = tag


def endpoints(catalogue: LineCatalogue, *, token_required: bool) -> APIRouter:
    """All endpoints of a store.

    Parameters
    ----------
    catalogue : lines and passes of the store
    token_required : whether the server requires a token; the viewer shows how to log out
    """
    router = APIRouter(prefix="/api", responses={
        status: {"model": responses.ErrorResponse}
        for status in (401, 403, 404, 414, 421, 422, 500)
    })  # fmt: skip
    _add_lists(router, catalogue, token_required)
    _add_levels(router, catalogue)
    _add_tables(router, catalogue)
    _add_development(router, catalogue)
    return router


def _add_lists(router: APIRouter, catalogue: LineCatalogue, token_required: bool) -> None:
    @router.get("/lines")
    def lines() -> responses.Lines:
        """Lines and directions of the store."""
        return responses.Lines(
            lines=[
                responses.LineInfo(
                    line=one.line,
                    direction=one.direction,
                    start_m=one.start,
                    end_m=one.end,
                    passes=one.passes,
                    first_day=one.days[0],
                    last_day=one.days[-1],
                )
                for one in catalogue.lines()
            ],
            bands=[
                responses.BandName(name=one.name, shortest_m=one.shortest, longest_m=one.longest)
                for one in BANDS
            ],
            token_required=token_required,
        )

    @router.get("/days")
    def days(asked: Annotated[requests.LineParameters, Query()]) -> responses.Days:
        """Days with passes over a line in one direction."""
        return responses.Days(days=list(catalogue.line(asked.line, asked.direction).days))

    @router.get("/passes")
    def passes(asked: Annotated[requests.PassesParameters, Query()]) -> responses.Passes:
        """Passes over a line in one direction, each in its newest version."""
        entries = catalogue.passes(asked.line, asked.direction, asked.first, asked.last)
        return responses.Passes(
            passes=[_pass_info(one) for one in entries[-MAX_PASSES:]],
            omitted_passes=max(0, len(entries) - MAX_PASSES),
        )

    @router.get("/quality")
    def quality(
        asked: Annotated[requests.QualityParameters, Query()], request: Request, response: Response
    ) -> responses.QualityResponse:
        """Coverage and uncertainty of the passes over a line."""
        entries = _passes(catalogue, asked, asked.first, asked.last)
        _add_tag(request, response, entries)
        return quality_response(catalogue, entries, asked.band, asked.bins)


def _add_levels(router: APIRouter, catalogue: LineCatalogue) -> None:
    @router.get("/level")
    def level(
        asked: Annotated[requests.LevelParameters, Query()], request: Request, response: Response
    ) -> responses.EnvelopeResponse:
        """The level in a band with its uncertainty, as minimum and maximum in bins."""
        entries = catalogue.passes_of_day(asked.line, asked.direction, asked.day, asked.entry)
        _add_tag(request, response, entries)
        stretch = _stretch(entries, asked)
        bins, notes = merge_passes(catalogue.store, entries, asked.band, stretch, asked.max_bins)
        return envelope_response(
            bins,
            asked.band,
            entries,
            heights=catalogue.limit_heights(entries, asked.band),
            not_assessed=not_assessed_stretches(catalogue.store, entries, asked.band, bins),
            notes=notes,
        )

    @router.get("/compare")
    def compare(
        asked: Annotated[requests.CompareParameters, Query()], request: Request, response: Response
    ) -> responses.ComparisonResponse:
        """Comparison of two days."""
        line, direction = asked.line, asked.direction
        one = catalogue.passes_of_day(line, direction, asked.day, asked.entry)
        other = catalogue.passes_of_day(line, direction, asked.compared_day, asked.compared_entry)
        days = (one, other) if one[0].day < other[0].day else (other, one)
        _add_tag(request, response, (*one, *other))
        return comparison_response(
            catalogue.store,
            days,
            band_of(asked.band),
            _stretch((*one, *other), asked),
            max_bins=asked.max_bins,
            heights=catalogue.limit_heights(days[1], asked.band),
        )


def _add_tables(router: APIRouter, catalogue: LineCatalogue) -> None:
    @router.get("/defects")
    def defects(
        asked: Annotated[requests.DefectsParameters, Query()], request: Request, response: Response
    ) -> responses.Defects:
        """Isolated defects that require an action, or may require one."""
        entries = catalogue.passes_of_day(asked.line, asked.direction, asked.day, asked.entry)
        _add_tag(request, response, entries)
        all_rows = rows.defect_rows(catalogue.store, entries, asked.start, asked.end)
        selected, grades = rows.select_defects(
            all_rows, asked.band, asked.minimum_action, asked.order
        )
        return responses.Defects(
            defects=rows.defect_list(selected.slice(asked.offset, asked.count)),
            total=selected.num_rows,
            counts=rows.counts(grades),
            requirements=rows.requirements(selected),
            notes=list(dict.fromkeys(note for one in entries for note in one.notes)),
        )

    @router.get("/schematic")
    def schematic(
        asked: Annotated[requests.SchematicParameters, Query()],
        request: Request,
        response: Response,
    ) -> responses.Schematic:
        """Overview of the defects of a line: the required actions in each bin."""
        entries = catalogue.passes_of_day(asked.line, asked.direction, asked.day, asked.entry)
        _add_tag(request, response, entries)
        return rows.schematic_response(catalogue.store, entries, _stretch(entries), asked.bins)

    @router.get("/sections")
    def sections(
        asked: Annotated[requests.SectionsParameters, Query()],
        request: Request,
        response: Response,
    ) -> responses.Sections:
        """Standard deviations per section."""
        entries = catalogue.passes_of_day(asked.line, asked.direction, asked.day, asked.entry)
        _add_tag(request, response, entries)
        length, columns = rows.section_columns(
            catalogue.store, entries, asked.band, asked.start, asked.end
        )
        return rows.sections_response(asked.band, length, columns, asked.count)


def _add_development(router: APIRouter, catalogue: LineCatalogue) -> None:
    @router.get("/development")
    def development(
        asked: Annotated[requests.DevelopmentParameters, Query()],
        request: Request,
        response: Response,
    ) -> responses.DevelopmentResponse:
        """Development of a location, and when it reaches a limit if the trend continues."""
        entries = _passes(catalogue, asked, asked.since, asked.until)
        _add_tag(request, response, entries)
        return development_response(
            catalogue.store,
            entries,
            band_of(asked.band),
            asked.at,
            catalogue.limit_heights(entries[-1:], asked.band),
        )


def _passes(
    catalogue: LineCatalogue,
    asked: requests.LineParameters,
    first: date | None,
    last: date | None,
) -> tuple[Entry, ...]:
    """Passes between two days.

    Raises
    ------
    UnknownError : there is none.
    """
    entries = catalogue.passes(asked.line, asked.direction, first, last)
    if not entries:
        raise UnknownError("The store has no pass between these days.")
    return entries


def _stretch(
    entries: Sequence[Entry], asked: requests.StretchParameters | None = None
) -> tuple[float, float]:
    """Start and end as requested, by default those of the passes [m]."""
    start, end = min(one.start for one in entries), max(one.end for one in entries)
    if asked is None:
        return start, end
    first = start if asked.start is None else asked.start
    last = end if asked.end is None else asked.end
    if not first < last:
        raise UnknownError(
            f"The passes extend from {start:.1f} m to {end:.1f} m, outside of the requested stretch."
        )
    return first, last


def _add_tag(request: Request, response: Response, entries: Sequence[Entry]) -> None:
    """Add the entity tag of an answer: the same request about the same entries has the same answer.

    Raises
    ------
    NotModifiedError : the client has the answer.
    """
    paths = [one.path(ENTRIES) for one in entries]
    tag = f'"{digest([__version__, request.url.path, request.url.query, paths])[:_TAG_DIGITS]}"'
    if tag in [one.strip() for one in request.headers.get("if-none-match", "").split(",")]:
        raise NotModifiedError(tag)
    response.headers["etag"] = tag
    response.headers["cache-control"] = "private, no-cache"


def _pass_info(entry: Entry) -> responses.PassInfo:
    origin = entry.origin
    return responses.PassInfo(
        entry=entry.id,
        line=entry.line,
        direction=entry.direction,
        day=entry.day,
        run=entry.run,
        start_m=entry.start,
        end_m=entry.end,
        known_share=entry.known_share,
        standard_deviation_mm={
            name: _MILLI * one for name, one in entry.standard_deviations.items()
        },
        defect_counts={name: count for name, count in entry.defects.items() if count},
        kind=entry.kind,
        vehicle=origin.vehicle,
        method=origin.method,
        track=origin.track,
        prior=origin.prior,
        limit_set=origin.limits,
        line_speed_km_h=round(origin.speed / KM_H, 3),
        source=origin.source,
        recording=origin.recording,
        software=origin.software,
        notes=list(entry.notes),
    )
