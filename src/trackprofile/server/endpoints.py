"""What can be asked at ``/api``: each endpoint is one question and one answer."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from trackprofile import __version__
from trackprofile.assessment.limits import KM_H
from trackprofile.bands import BANDS
from trackprofile.server import assessment_rows as rows
from trackprofile.server import chart_data as strips
from trackprofile.server import history as places
from trackprofile.server import requests as ask
from trackprofile.server import responses as models
from trackprofile.server.data_quality import quality as quality_of
from trackprofile.server.line_catalogue import Catalogue, UnknownError
from trackprofile.store import Entry
from trackprofile.store.layout import ENTRIES

MOST_PASSES = 1000
"""In one list: the latest."""

_MILLI = 1e3


class UnchangedError(Exception):
    """The reader has the answer already."""

    def __init__(self, tag: str) -> None:
        super().__init__(tag)
        self.tag = tag


def endpoints(catalogue: Catalogue, *, locked: bool) -> APIRouter:
    """All questions about a store.

    Parameters
    ----------
    catalogue : of the store
    locked : whether a token is asked for
    """
    router = APIRouter(prefix="/api", responses={
        status: {"model": models.ErrorResponse} for status in (401, 403, 404, 414, 421, 422, 500)
    })  # fmt: skip
    _add_lists(router, catalogue, locked)
    _add_strips(router, catalogue)
    _add_tables(router, catalogue)
    _add_times(router, catalogue)
    return router


def _add_lists(router: APIRouter, catalogue: Catalogue, locked: bool) -> None:
    @router.get("/lines")
    def lines() -> models.Lines:
        """Which lines and directions there are."""
        return models.Lines(
            lines=[
                models.LineInfo(
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
                models.BandName(name=one.name, shortest_m=one.shortest, longest_m=one.longest)
                for one in BANDS
            ],
            locked=locked,
        )

    @router.get("/days")
    def days(asked: Annotated[ask.LineQuestion, Query()]) -> models.Days:
        """On which days a line was passed in one direction."""
        return models.Days(days=list(catalogue.line(asked.line, asked.direction).days))

    @router.get("/passes")
    def passes(asked: Annotated[ask.PassesQuestion, Query()]) -> models.Passes:
        """Which passes there are over a line in one direction, each in its newest version."""
        found = catalogue.passes(asked.line, asked.direction, asked.first, asked.last)
        return models.Passes(
            passes=[_pass_info(one) for one in found[-MOST_PASSES:]],
            omitted=max(0, len(found) - MOST_PASSES),
        )

    @router.get("/quality")
    def quality(
        asked: Annotated[ask.QualityQuestion, Query()], request: Request, response: Response
    ) -> models.QualityResponse:
        """How much of a line its passes tell, and how well."""
        found = catalogue.passes(asked.line, asked.direction, asked.first, asked.last)
        if not found:
            raise UnknownError("There is no pass within these days.")
        _tag(request, response, found)
        return quality_of(catalogue, found, asked.band, asked.bins)


def _add_strips(router: APIRouter, catalogue: Catalogue) -> None:
    @router.get("/strip")
    def strip(
        asked: Annotated[ask.StripQuestion, Query()], request: Request, response: Response
    ) -> models.EnvelopeResponse:
        """The level in a band with its uncertainty, in not more bins than can be drawn."""
        entries = catalogue.of_day(asked.line, asked.direction, asked.day, asked.entry)
        _tag(request, response, entries)
        start, end = _stretch(entries, asked)
        bins, notes = strips.merged(catalogue.store, entries, asked.band, start, end, asked.width)
        return strips.model(
            bins,
            asked.band,
            entries,
            catalogue.heights(entries, asked.band),
            strips.not_judged(catalogue.store, entries, asked.band, bins),
            notes,
        )

    @router.get("/compare")
    def compare(
        asked: Annotated[ask.CompareQuestion, Query()], request: Request, response: Response
    ) -> models.ComparisonResponse:
        """Two days against each other."""
        one = catalogue.of_day(asked.line, asked.direction, asked.day, asked.entry)
        other = catalogue.of_day(asked.line, asked.direction, asked.other, asked.other_entry)
        days = (one, other) if one[0].day < other[0].day else (other, one)
        _tag(request, response, (*one, *other))
        return places.compare(
            catalogue.store,
            days,
            places.band_of(asked.band),
            _stretch((*one, *other), asked),
            asked.width,
            catalogue.heights(days[1], asked.band),
        )


def _add_tables(router: APIRouter, catalogue: Catalogue) -> None:
    @router.get("/defects")
    def defects(
        asked: Annotated[ask.DefectsQuestion, Query()], request: Request, response: Response
    ) -> models.Defects:
        """Isolated defects: places that call for something, or may."""
        entries = catalogue.of_day(asked.line, asked.direction, asked.day, asked.entry)
        _tag(request, response, entries)
        every = rows.defect_rows(catalogue.store, entries, asked.start, asked.end)
        found, grades = rows.chosen(every, asked.band, asked.least, asked.order)
        return models.Defects(
            defects=rows.defect_models(found.slice(asked.offset, asked.count)),
            total=found.num_rows,
            counts=rows.counts(grades),
            duties=rows.duties(found),
            notes=list(dict.fromkeys(note for one in entries for note in one.notes)),
        )

    @router.get("/schematic")
    def schematic(
        asked: Annotated[ask.SchematicQuestion, Query()], request: Request, response: Response
    ) -> models.Schematic:
        """The same at a glance: what the places of each bin of the line call for."""
        entries = catalogue.of_day(asked.line, asked.direction, asked.day, asked.entry)
        _tag(request, response, entries)
        return rows.schematic(catalogue.store, entries, _stretch(entries), asked.bins)

    @router.get("/sections")
    def sections(
        asked: Annotated[ask.SectionsQuestion, Query()], request: Request, response: Response
    ) -> models.Sections:
        """Standard deviations per section."""
        entries = catalogue.of_day(asked.line, asked.direction, asked.day, asked.entry)
        _tag(request, response, entries)
        length, columns = rows.section_columns(
            catalogue.store, entries, asked.band, asked.start, asked.end
        )
        return rows.sections(asked.band, length, columns, asked.count)


def _add_times(router: APIRouter, catalogue: Catalogue) -> None:
    @router.get("/place")
    def place(
        asked: Annotated[ask.PlaceQuestion, Query()], request: Request, response: Response
    ) -> models.DevelopmentResponse:
        """How a place developed, and when a limit is reached if that goes on."""
        found = catalogue.passes(asked.line, asked.direction, asked.since, asked.until)
        if not found:
            raise UnknownError("There is no pass within these days.")
        _tag(request, response, found)
        return places.place(
            catalogue.store,
            found,
            places.band_of(asked.band),
            asked.at,
            catalogue.heights(found[-1:], asked.band),
        )


def _stretch(entries: Sequence[Entry], asked: ask.Stretch | None = None) -> tuple[float, float]:
    """From where to where: as asked, or as far as the passes go."""
    start, end = min(one.start for one in entries), max(one.end for one in entries)
    if asked is None:
        return start, end
    first = start if asked.start is None else asked.start
    last = end if asked.end is None else asked.end
    if not first < last:
        raise UnknownError(f"The passes run from {start:.1f} m to {end:.1f} m, not there.")
    return first, last


def _tag(request: Request, response: Response, entries: Sequence[Entry]) -> None:
    """State what the answer depends on; the same question about the same entries has the same answer.

    Raises
    ------
    UnchangedError : the reader has it.
    """
    about = (
        __version__,
        request.url.path,
        request.url.query,
        *(one.path(ENTRIES) for one in entries),
    )
    digest = hashlib.sha256("\n".join(about).encode()).hexdigest()
    tag = f'"{digest[:24]}"'
    if tag in [one.strip() for one in request.headers.get("if-none-match", "").split(",")]:
        raise UnchangedError(tag)
    response.headers["etag"] = tag
    response.headers["cache-control"] = "private, no-cache"


def _pass_info(entry: Entry) -> models.PassInfo:
    origin = entry.origin
    return models.PassInfo(
        entry=entry.id,
        line=entry.line,
        direction=entry.direction,
        day=entry.day,
        run=entry.run,
        start_m=entry.start,
        end_m=entry.end,
        known_share=entry.known,
        deviation_mm={name: _MILLI * one for name, one in entry.deviations.items()},
        counts={name: count for name, count in entry.defects.items() if count},
        kind=entry.kind,
        vehicle=origin.vehicle,
        method=origin.method,
        track=origin.track,
        prior=origin.prior,
        limits=origin.limits,
        speed_km_h=round(origin.speed / KM_H, 3),
        source=origin.source,
        recording=origin.recording,
        software=origin.software,
        notes=list(entry.notes),
    )
