"""The server against its own OpenAPI description: every answer agrees with it, and none is an internal error."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

pytest.importorskip("fastapi")
pytest.importorskip("schemathesis")

import schemathesis
import schemathesis.checks
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dated_passes import BRANCH, DOWN, FIRST, MAIN, START, UP
from serving import serving
from trackprofile.store import Store

MAX_SECONDS = 8.0
"""Time that one answer may take on a busy machine."""

STORED = {
    "line": MAIN,
    "direction": UP,
    "day": str(FIRST),
    "compared_day": str(FIRST),
    "at": START + 800,
}
STRETCH = STORED | {
    "from": START + 700,
    "to": START + 1900,
    "entry": None,
    "minimum_action": None,
    "offset": 0,
}
BRANCH_LINE = {
    "line": BRANCH,
    "direction": DOWN,
    "day": str(FIRST),
    "compared_day": str(FIRST),
    "at": 2250,
}


@pytest.fixture(scope="module")
def schema(dated_store: Store) -> Iterator[object]:
    with serving(dated_store) as client:
        yield schemathesis.openapi.from_url(f"{client.base_url}openapi.json")


OPERATIONS = (
    "compare",
    "days",
    "defects",
    "development",
    "level",
    "lines",
    "passes",
    "quality",
    "schematic",
    "sections",
)


def check(schema, operation: str, examples: int, mode) -> None:
    """Send generated requests, some of them with names that the store has."""
    endpoint = schema[f"/api/{operation}"]["GET"]

    @given(
        case=endpoint.as_strategy(generation_mode=mode),
        real=st.sampled_from([{}, STORED, STRETCH, BRANCH_LINE]),
    )
    @settings(
        max_examples=examples, derandomize=True, deadline=None, database=None,
        suppress_health_check=list(HealthCheck),  # type: ignore[call-overload]
    )  # fmt: skip
    def ask(case, real) -> None:
        if mode.is_positive and case.query:
            case.query.update({name: one for name, one in real.items() if name in case.query})
            case.query = {name: one for name, one in case.query.items() if one is not None}
        start = time.monotonic()
        answer = case.call()
        assert time.monotonic() - start < MAX_SECONDS
        assert answer.status_code < 500, answer.text
        checks = schemathesis.checks
        case.validate_response(
            answer,
            checks=[
                checks.not_a_server_error,
                checks.CHECKS.get_one("status_code_conformance"),
                checks.CHECKS.get_one("content_type_conformance"),
                checks.CHECKS.get_one("response_schema_conformance"),
            ],
        )
        if mode.is_negative:
            assert answer.status_code in (200, 404, 414, 422)
        if answer.status_code >= 400:
            assert answer.json().keys() == {"error"}

    ask()


@pytest.mark.parametrize("operation", ["level"])
def test_answers_agree_with_the_description(schema, operation: str) -> None:
    check(schema, operation, 25, schemathesis.GenerationMode.POSITIVE)
    check(schema, operation, 15, schemathesis.GenerationMode.NEGATIVE)


@pytest.mark.acceptance
@pytest.mark.parametrize("operation", OPERATIONS)
@pytest.mark.parametrize("mode", list(schemathesis.GenerationMode))
def test_every_answer_agrees_with_the_description(schema, operation: str, mode) -> None:
    if operation == "lines" and mode.is_negative:
        pytest.skip("the endpoint has no parameters")
    check(schema, operation, 150, mode)
