"""The server against its own OpenAPI description: whatever is asked, the answer is as described and never an error."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

pytest.importorskip("fastapi")
pytest.importorskip("schemathesis")

import schemathesis
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dated_passes import BRANCH, DOWN, FIRST, MAIN, START, UP
from serving import serving
from trackprofile.store import Store

LONGEST = 8.0
"""s that one answer may take, on a machine that does other things too."""

THERE = {"line": MAIN, "direction": UP, "day": str(FIRST), "other": str(FIRST), "at": START + 800}
NEAR = THERE | {"from": START + 700, "to": START + 1900, "entry": None, "least": None, "offset": 0}
BESIDE = {"line": BRANCH, "direction": DOWN, "day": str(FIRST), "other": str(FIRST), "at": 2250}


@pytest.fixture(scope="module")
def schema(dated_store: Store) -> Iterator[object]:
    with serving(dated_store) as client:
        yield schemathesis.openapi.from_url(f"{client.base_url}openapi.json")


OPERATIONS = (
    "compare",
    "days",
    "defects",
    "lines",
    "passes",
    "place",
    "quality",
    "schematic",
    "sections",
    "strip",
)


def checked(schema, operation: str, examples: int, mode) -> None:
    """Ask generated questions, a half of them about what is there."""
    found = schema[f"/api/{operation}"]["GET"]

    @given(
        case=found.as_strategy(generation_mode=mode),
        real=st.sampled_from([{}, THERE, NEAR, BESIDE]),
    )
    @settings(
        max_examples=examples, derandomize=True, deadline=None, database=None,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    def ask(case, real) -> None:
        if mode.is_positive and case.query:
            case.query.update({name: one for name, one in real.items() if name in case.query})
            case.query = {name: one for name, one in case.query.items() if one is not None}
        begun = time.monotonic()
        answer = case.call()
        assert time.monotonic() - begun < LONGEST
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


@pytest.mark.parametrize("operation", ["strip"])
def test_answers_are_as_described(schema, operation: str) -> None:
    checked(schema, operation, 25, schemathesis.GenerationMode.POSITIVE)
    checked(schema, operation, 15, schemathesis.GenerationMode.NEGATIVE)


@pytest.mark.acceptance
@pytest.mark.parametrize("operation", OPERATIONS)
@pytest.mark.parametrize("mode", list(schemathesis.GenerationMode))
def test_every_answer_is_as_described(schema, operation: str, mode) -> None:
    if operation == "lines" and mode.is_negative:
        pytest.skip("there is nothing to ask wrongly")
    checked(schema, operation, 150, mode)
