"""Answers of the server, compared with the same quantities computed directly from the stored tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from datetime import date, timedelta
from typing import get_args

import httpx
import numpy as np
import pytest

from narrowing import not_none

pytest.importorskip("fastapi")

from dated_passes import (
    BRANCH,
    DOWN,
    EN,
    FIRST,
    LENGTH,
    MAIN,
    SETTLES,
    SPEED,
    START,
    UP,
    dip,
    put,
    seen,
)
from serving import serving
from trackprofile.assessment.limits import Action
from trackprofile.bands import BANDS, band_pass
from trackprofile.server import history, line_catalogue
from trackprofile.server import requests as server_requests
from trackprofile.store import Store, create, find, lines, read_columns, read_table
from trackprofile.store.layout import PassKey

DAYS = [FIRST + timedelta(days=30 * month) for month in range(4)]
SEVERITY = {"": 0, "alert": 1, "intervention": 2, "immediate action": 3}
LAST = {"line": MAIN, "direction": UP, "day": str(DAYS[-1])}


@pytest.fixture(scope="module")
def client(dated_store: Store) -> Iterator[httpx.Client]:
    with serving(dated_store) as running:
        yield running


def ask(client: httpx.Client, endpoint: str, **params) -> dict:
    answer = client.get(
        f"/api/{endpoint}", params={key.rstrip("_"): one for key, one in params.items()}
    )
    assert answer.status_code == 200, answer.text
    return answer.json()


def entry_of(store: Store, day: date, line: str = MAIN, number: int = 0):
    return find(store, line=line, first=day, last=day)[number]


def known(values: list) -> np.ndarray:
    return np.array([np.nan if one is None else one for one in values])


# --- lists --------------------------------------------------------------------------------------


def test_lines_are_those_of_the_store(client: httpx.Client, dated_store: Store) -> None:
    answer = ask(client, "lines")
    assert [(one["line"], one["direction"], one["passes"]) for one in answer["lines"]] == [
        (one.line, one.direction, one.passes) for one in lines(dated_store)
    ]
    assert answer["lines"][1]["start_m"] == START
    assert [one["name"] for one in answer["bands"]] == [one.name for one in BANDS]
    assert answer["token_required"] is False
    days = ask(client, "days", line=MAIN, direction=UP)["days"]
    assert days == [str(day) for day in DAYS]


def test_passes_agree_with_the_entries_of_the_store(
    client: httpx.Client, dated_store: Store
) -> None:
    answer = ask(client, "passes", line=MAIN, direction=UP)["passes"]
    entries = find(dated_store, line=MAIN)
    assert [one["entry"] for one in answer] == [one.id for one in entries]
    for one, entry in zip(answer, entries, strict=True):
        assert (one["day"], one["run"], one["limit_set"]) == (str(entry.day), entry.run, EN.name)
        assert one["line_speed_km_h"] == pytest.approx(140.0)
        assert one["standard_deviation_mm"]["D2"] == pytest.approx(
            1e3 * entry.standard_deviations["D2"]
        )
        assert sum(one["defect_counts"].values()) == sum(entry.defects.values())
    some = ask(client, "passes", line=MAIN, direction=UP, first=str(DAYS[1]), last=str(DAYS[2]))
    assert [one["day"] for one in some["passes"]] == [str(DAYS[1]), str(DAYS[2])]


# --- levels -------------------------------------------------------------------------------------


@pytest.mark.parametrize("band", ["D1", "D3"])
@pytest.mark.parametrize(
    ("start", "end", "width"),
    [(0.0, LENGTH, 300), (1400.3, 1617.7, 400), (2350.0, 2700.0, 8000), (-500.0, 700.0, 50)],
)
def test_level_is_minimum_and_maximum_in_every_bin(
    client: httpx.Client, dated_store: Store, band: str, start: float, end: float, width: int
) -> None:
    day = DAYS[2]  # the one with a gap
    strip = ask(
        client, "level", **LAST | {"day": str(day)}, band=band, from_=START + start, to=START + end, max_bins=width
    )  # fmt: skip
    names = [f"level_{band}_m", f"standard_deviation_{band}_m"]
    rows = read_columns(dated_store, entry_of(dated_store, day), ["distance_m", *names])
    edges = strip["from_m"] + strip["bin_m"] * np.arange(len(strip["low_mm"]) + 1)
    assert len(strip["low_mm"]) <= width
    assert strip["from_m"] <= START + start
    assert strip["to_m"] == edges[-1] > START + end - strip["bin_m"]
    low, high, deviation = (
        known(strip[name]) for name in ("low_mm", "high_mm", "standard_deviation_mm")
    )
    for i in range(low.size):
        inside = (rows["distance_m"] >= edges[i]) & (rows["distance_m"] < edges[i + 1])
        level = 1e3 * rows[names[0]][inside]
        if not np.isfinite(level).any():
            assert np.isnan([low[i], high[i]]).all()
            continue
        assert low[i] == pytest.approx(np.nanmin(level), abs=6e-4)
        assert high[i] == pytest.approx(np.nanmax(level), abs=6e-4)
        assert deviation[i] == pytest.approx(1e3 * rows[names[1]][inside].max(), abs=6e-5)


def test_level_of_a_day_encloses_all_its_passes(client: httpx.Client, dated_store: Store) -> None:
    parameters = {"line": BRANCH, "direction": DOWN, "day": str(FIRST), "band": "D1"}
    stretch = {"from": 1900, "to": 2600, "max_bins": 100}
    both = ask(client, "level", **parameters, **stretch)
    entries = find(dated_store, line=BRANCH)
    single = [ask(client, "level", **parameters, **stretch, entry=one.id) for one in entries]
    assert both["entries"] == [one.id for one in entries]
    for name, extreme in (("low_mm", np.fmin), ("high_mm", np.fmax)):
        expected = extreme(known(single[0][name]), known(single[1][name]))
        assert known(both[name]) == pytest.approx(expected, nan_ok=True)
    assert np.isfinite(known(both["low_mm"])).all()
    assert not np.isfinite(known(single[1]["low_mm"])).all()


def test_level_states_limits_and_stretches_not_assessed(
    client: httpx.Client, dated_store: Store
) -> None:
    strip = ask(client, "level", **LAST, band="D1")
    heights = not_none(EN.defects_at("D1", SPEED)).heights
    assert [(one["action"], one["height_mm"]) for one in strip["limits"]] == [
        (action.text, pytest.approx(1e3 * heights[action])) for action in Action
    ]
    rows = read_table(dated_store, [entry_of(dated_store, DAYS[-1])], "not_assessed")
    expected = [
        (start, end, why)
        for band, start, end, why in zip(
            rows["band"], rows["start_m"], rows["end_m"], rows["reasons"], strict=True
        )
        if band == "D1"
    ]
    assert [
        (one["start_m"], one["end_m"], one["reasons"]) for one in strip["not_assessed"]
    ] == expected
    # the limit set has no limits for D2 at this speed
    assert ask(client, "level", **LAST, band="D2")["limits"] == []


def test_limits_are_given_without_any_defect(tmp_path) -> None:
    store = create(str(tmp_path / "calm"))
    calm = seen(0, 1000.0, seed=5)
    calm["elevation"] = calm["elevation"] * 0.01
    put(store, PassKey("calm", "up", FIRST), calm)
    with serving(store) as client:
        strip = ask(client, "level", line="calm", direction="up", day=str(FIRST), band="D1")
        defects = ask(client, "defects", line="calm", direction="up", day=str(FIRST))
    assert [one["height_mm"] for one in strip["limits"]] == [8.0, 10.0, 23.0]
    assert (defects["total"], defects["counts"]) == (0, {})


# --- tables -------------------------------------------------------------------------------------


def stored_defects(store: Store, day: date) -> list[dict]:
    columns = read_table(store, find(store, line=MAIN, first=day, last=day), "defects")
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def test_defects_are_complete_and_the_most_severe_come_first(
    client: httpx.Client, dated_store: Store
) -> None:
    answer = ask(client, "defects", **LAST)
    stored = stored_defects(dated_store, DAYS[-1])
    stored.sort(
        key=lambda one: (
            -SEVERITY[one["required_action"]],
            -abs(one["height_mm"]) / one["limit_alert_mm"],
        )
    )
    assert [one["peak_m"] for one in answer["defects"]] == [one["peak_m"] for one in stored]
    assert answer["total"] == len(stored) >= 5
    for one, other in zip(answer["defects"], stored, strict=True):
        assert one["required_action"] == other["required_action"]
        assert one["height_mm"] == other["height_mm"]
        assert one["probabilities"]["alert"] == other["probability_alert"]
        assert one["limits_mm"]["intervention"] == other["limit_intervention_mm"]
    counted = Counter(one["required_action"] or "possible" for one in stored)
    assert answer["counts"] == counted
    assert answer["requirements"][0]["action"] == "immediate action"
    assert any("not verified" in note for note in answer["notes"])


@pytest.mark.parametrize("order", ["severity", "distance"])
def test_pages_of_defects_add_up_to_the_whole(client: httpx.Client, order: str) -> None:
    whole = ask(client, "defects", **LAST, order=order)["defects"]
    pages = [
        one
        for offset in range(0, len(whole) + 2, 2)
        for one in ask(client, "defects", **LAST, order=order, offset=offset, count=2)["defects"]
    ]
    assert pages == whole
    if order == "distance":
        assert [one["peak_m"] for one in whole] == sorted(one["peak_m"] for one in whole)


def test_defects_are_filtered_by_stretch_band_and_action(
    client: httpx.Client, dated_store: Store
) -> None:
    stored = stored_defects(dated_store, DAYS[-1])
    start, end = START + 1400, START + 3300
    near = ask(client, "defects", **LAST, from_=start, to=end, order="distance")
    assert [one["peak_m"] for one in near["defects"]] == sorted(
        one["peak_m"] for one in stored if one["end_m"] >= start and one["start_m"] <= end
    )
    severe = ask(client, "defects", **LAST, minimum_action="intervention")
    assert (
        severe["total"]
        == sum(SEVERITY[one["required_action"]] >= 2 for one in stored)
        < len(stored)
    )
    assert ask(client, "defects", **LAST, band="D2")["total"] == 0


def test_schematic_counts_every_defect_once(client: httpx.Client, dated_store: Store) -> None:
    answer = ask(client, "schematic", **LAST, bins=50)
    stored = stored_defects(dated_store, DAYS[-1])
    size = (answer["end_m"] - answer["start_m"]) / 50
    expected = Counter(
        (int((one["peak_m"] - answer["start_m"]) / size), one["required_action"]) for one in stored
    )
    assert {
        (round((one["start_m"] - answer["start_m"]) / size), one["required_action"]): one["defects"]
        for one in answer["bins"]
    } == expected
    deepest = min(stored, key=lambda one: one["height_mm"])
    assert deepest["peak_m"] in [one["peak_m"] for one in answer["bins"]]


def stored_sections(store: Store, day: date, band: str) -> list[tuple[float, float]]:
    columns = read_table(store, find(store, line=MAIN, first=day, last=day), "sections")
    rows = zip(
        columns["band"], columns["length_m"], columns["start_m"], columns["standard_deviation_mm"], strict=True
    )  # fmt: skip
    return [(start, value) for name, length, start, value in rows if name == band and length > 150]


@pytest.mark.parametrize("count", [500, 7, 1])
def test_sections_are_the_worst_of_each_group(
    client: httpx.Client, dated_store: Store, count: int
) -> None:
    answer = ask(client, "sections", **LAST, band="D1", count=count)
    stored = stored_sections(dated_store, DAYS[-1], "D1")
    assert answer["length_m"] == 200.0
    assert len(answer["sections"]) <= count + 1  # groups begin at multiples of their length
    groups: dict[int, float] = {}
    for start, value in stored:
        group = int(start // 200) // answer["group_size"]
        groups[group] = max(value, groups.get(group, 0.0))
    assert [one["standard_deviation_mm"] for one in answer["sections"]] == pytest.approx(
        [groups[key] for key in sorted(groups)], abs=6e-5
    )


# --- development and comparison ------------------------------------------------------------------------


def true_rate(band: int) -> float:
    """Rate at the settling location in a band [mm/day]."""
    at = np.arange(0.0, LENGTH, 0.25)
    shape = band_pass(dip(at, SETTLES, 0.0025, 3.0), 0.25, BANDS[band])
    return 1e3 * shape[int(SETTLES / 0.25)] / 30


def test_development_of_a_location_agrees_with_the_simulated_settlement(
    client: httpx.Client, dated_store: Store
) -> None:
    answer = ask(client, "development", line=MAIN, direction=UP, band="D1", at=START + SETTLES)
    assert [one["day"] for one in answer["passes"]] == [str(day) for day in DAYS]
    trend = answer["trend"]
    assert (
        abs(trend["rate_mm_per_day"] - true_rate(0))
        < 4 * trend["rate_standard_deviation_mm_per_day"]
    )
    assert trend["rate_standard_deviation_mm_per_day"] < 0.1 * abs(true_rate(0))
    for day, level in zip(DAYS, answer["level_mm"], strict=True):
        names = ["distance_m", "level_D1_m"]
        rows = read_columns(dated_store, entry_of(dated_store, day), names)
        index = np.argmin(np.abs(rows["distance_m"] - START - SETTLES))
        assert level == pytest.approx(1e3 * rows["level_D1_m"][index], abs=0.3)  # lags and a gap
    ahead = answer["forecast"]
    assert ahead[0]["day"] == str(DAYS[0])
    assert ahead[-1]["day"] > str(DAYS[-1])
    slope = (ahead[-1]["level_mm"] - ahead[0]["level_mm"]) / (
        date.fromisoformat(ahead[-1]["day"]) - DAYS[0]
    ).days
    assert slope == pytest.approx(trend["rate_mm_per_day"], rel=1e-2)
    last, limit = answer["level_mm"][-1], answer["limit_crossings"][0]
    days = (limit["height_mm"] - abs(last)) / abs(trend["rate_mm_per_day"])
    assert (date.fromisoformat(limit["median"]) - DAYS[-1]).days == pytest.approx(days, abs=12)
    assert limit["earliest"] <= limit["median"] <= limit["latest"]


def test_a_pass_with_a_gap_at_the_location_is_excluded_with_its_reason(
    client: httpx.Client,
) -> None:
    answer = ask(client, "development", line=MAIN, direction=UP, band="D1", at=START + 2440)
    assert [one["day"] for one in answer["excluded"]] == [str(DAYS[2])]
    assert "gap" in answer["excluded"][0]["reason"]
    since = ask(
        client,
        "development",
        line=MAIN,
        direction=UP,
        band="D1",
        at=START + 800,
        since=str(DAYS[2]),
    )
    assert [one["day"] for one in since["passes"]] == [str(day) for day in DAYS[2:]]


def test_passes_of_one_day_determine_no_rate(client: httpx.Client) -> None:
    answer = ask(client, "development", line=BRANCH, direction=DOWN, band="D1", at=2250)
    assert len(answer["passes"]) == 2
    assert answer["trend"] is None
    assert answer["forecast"] == answer["limit_crossings"] == []


def test_of_many_passes_some_are_used_and_the_omitted_ones_counted(
    client: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(history, "MAX_PASSES", 3)
    answer = ask(client, "development", line=MAIN, direction=UP, band="D1", at=START + 800)
    assert answer["omitted_passes"] == 1
    assert [one["day"] for one in answer["passes"]][::2] == [str(DAYS[0]), str(DAYS[-1])]


def test_two_dates_differ_only_where_the_track_settled(client: httpx.Client) -> None:
    answer = ask(
        client, "compare", **LAST, compared_day=str(DAYS[0]), band="D1", from_=START + 2700, to=START + 3700,
        max_bins=8000,
    )  # fmt: skip
    assert (answer["first_day"], answer["second_day"]) == (str(DAYS[0]), str(DAYS[-1]))
    assert [round(one["peak_m"] - START - SETTLES) for one in answer["locations"]] == [0]
    location = answer["locations"][0]
    assert abs(location["change_mm"] - 90 * true_rate(0)) < 4 * location["standard_deviation_mm"]
    strip = answer["difference"]
    i = int((START + SETTLES - strip["from_m"]) / strip["bin_m"])
    assert strip["low_mm"][i] == pytest.approx(90 * true_rate(0), abs=0.5)
    one = ask(
        client, "level", **LAST, band="D1", from_=START + 2700, to=START + 3700, max_bins=8000
    )
    assert answer["second"]["low_mm"] == one["low_mm"]
    # the order of the two days in the request makes no difference
    other = ask(
        client, "compare", **LAST | {"day": str(DAYS[0])}, compared_day=str(DAYS[-1]), band="D1",
        from_=START + 2700, to=START + 3700, max_bins=8000,
    )  # fmt: skip
    assert other["difference"] == strip


def test_over_a_long_stretch_two_dates_are_compared_by_section(
    client: httpx.Client, dated_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(history, "MAX_POINTWISE_LENGTH", 1000.0)
    answer = ask(client, "compare", **LAST, compared_day=str(DAYS[0]), band="D1")
    before, after = (dict(stored_sections(dated_store, day, "D1")) for day in (DAYS[0], DAYS[-1]))
    strip = answer["difference"]
    assert (answer["section_length_m"], strip["bin_m"]) == (200.0, 200.0)
    for start in before.keys() & after.keys():
        i = int((start + 100 - strip["from_m"]) / strip["bin_m"])
        assert strip["low_mm"][i] == pytest.approx(after[start] - before[start], abs=2e-3)
    worst = int(np.nanargmax(known(strip["high_mm"])))
    assert strip["from_m"] + 200 * worst <= START + SETTLES < strip["from_m"] + 200 * (worst + 1)


def test_passes_that_cannot_be_aligned_are_shown_with_a_note(tmp_path) -> None:
    store = create(str(tmp_path / "unlike"))
    for month in (0, 1):
        day = FIRST + timedelta(days=30 * month)
        put(store, PassKey("unlike", "up", day), seen(month, 800.0, seed=7 + month))
    with serving(store) as client:
        answer = ask(
            client, "compare", line="unlike", direction="up", day=str(day), compared_day=str(FIRST), band="D1"
        )  # fmt: skip
    assert any("correlate with the first profile" in note for note in answer["notes"])
    assert answer["locations"] == []
    assert any(one is not None for one in answer["first"]["low_mm"])


# --- data quality -------------------------------------------------------------------------------


def test_quality_shows_gap_and_flags(client: httpx.Client, dated_store: Store) -> None:
    answer = ask(client, "quality", line=MAIN, direction=UP, band="D1", bins=300)
    assert [one["day"] for one in answer["passes"]] == [str(day) for day in DAYS]
    gapped = answer["passes"][2]
    lost = [i for i, one in enumerate(gapped["standard_deviation_along_mm"]) if one is None]
    assert lost == [121, 122, 123]  # of 20 m each, all of which lie between 2400 and 2480 m
    assert {one["name"] for one in gapped["flags"]} == {"gap", "edge", "slow"}
    assert {one["name"] for one in answer["passes"][0]["flags"]} == {"edge"}
    assert gapped["known_share"] == entry_of(dated_store, DAYS[2]).known_share < 1
    names = ["distance_m", "standard_deviation_D1_m"]
    rows = read_columns(dated_store, entry_of(dated_store, DAYS[0]), names)
    for i in (0, 100, 299):
        start = answer["start_m"] + i * answer["bin_m"]
        inside = (rows["distance_m"] >= start) & (rows["distance_m"] < start + answer["bin_m"])
        assert answer["passes"][0]["standard_deviation_along_mm"][i] == pytest.approx(
            1e3 * rows[names[1]][inside].max(), rel=0.02
        )


# --- versions, caches, and errors ----------------------------------------------------


def test_an_earlier_version_can_still_be_requested(tmp_path) -> None:
    from trackprofile.assessment.assess import assess
    from trackprofile.store import add

    store = create(str(tmp_path / "versions"))
    key, profile = PassKey("one", "up", FIRST), seen(0, 700.0)
    old = put(store, key, profile)
    deeper = profile.copy()
    deeper["elevation"] = profile["elevation"] * 2.0
    new = add(
        store, key, deeper, assess(deeper, EN, SPEED), replace(old.origin, revision=1)
    ).entry  # fmt: skip
    with serving(store) as client:
        parameters = {"line": "one", "direction": "up", "day": str(FIRST), "band": "D1"}
        listed = ask(client, "passes", line="one", direction="up")["passes"]
        latest, before = (
            ask(client, "level", **parameters),
            ask(client, "level", **parameters, entry=old.id),
        )
    assert [one["entry"] for one in listed] == latest["entries"] == [new.id]
    assert known(latest["low_mm"]) == pytest.approx(
        2 * known(before["low_mm"]), abs=5e-3, nan_ok=True
    )


def test_the_same_recording_on_two_days_is_two_passes(tmp_path) -> None:
    from trackprofile.assessment.assess import assess
    from trackprofile.store import add

    store, profile = create(str(tmp_path / "twice")), seen(0, 1500.0)
    one = put(store, PassKey("one", "up", FIRST), profile)
    later = PassKey("one", "up", FIRST + timedelta(days=30))
    other = add(store, later, profile, assess(profile, EN, SPEED), one.origin).entry
    assert other.id == one.id
    with serving(store) as client:
        development = ask(client, "development", line="one", direction="up", band="D1", at=750)
        two = ask(
            client, "compare", line="one", direction="up", band="D1", day=str(later.day), compared_day=str(FIRST)
        )  # fmt: skip
    assert [one["day"] for one in development["passes"]] == [str(FIRST), str(later.day)]
    assert np.nanmax(np.abs(known(two["difference"]["high_mm"]))) < 2e-3  # answered to 0.001


def test_an_added_pass_appears_after_the_cache_expires(
    tmp_path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = create(str(tmp_path / "grows"))
    with serving(store) as client:
        assert ask(client, "lines")["lines"] == []
        put(store, PassKey("new", "up", FIRST), seen(0, 700.0))
        assert ask(client, "lines")["lines"] == []
    monkeypatch.setattr(line_catalogue, "LIFETIME", 0.0)
    with serving(store) as client:
        assert ask(client, "lines")["lines"][0]["line"] == "new"


def test_an_unchanged_answer_is_not_sent_again(client: httpx.Client) -> None:
    parameters = LAST | {"band": "D1", "max_bins": "100"}
    first = client.get("/api/level", params=parameters)
    tag = {"if-none-match": first.headers["etag"]}
    again = client.get("/api/level", params=parameters, headers=tag)
    assert (again.status_code, again.content) == (304, b"")
    assert (
        client.get("/api/level", params=parameters | {"band": "D2"}, headers=tag).status_code == 200
    )
    page = client.get("/static/main.js")
    tag = {"if-none-match": page.headers["etag"]}
    assert client.get("/static/main.js", headers=tag).status_code == 304


def test_head_is_get_without_a_body(client: httpx.Client) -> None:
    answer = client.head("/api/lines")
    assert (answer.status_code, answer.content) == (200, b"")
    assert answer.headers["content-type"] == "application/json"


@pytest.mark.parametrize(
    ("endpoint", "params", "words"),
    [
        ("passes", {"line": "no", "direction": "up"}, "has no line 'no'"),
        ("level", LAST | {"day": "2020-01-01", "band": "D1"}, "no pass of"),
        ("level", LAST | {"band": "D1", "entry": f"{16 * '0'}-{16 * '0'}"}, "no pass 0000"),
        ("development", {"line": MAIN, "direction": UP, "band": "D1", "at": "5"}, "covers 5.0 m"),
        ("level", LAST | {"band": "D1", "from": "90000"}, "outside of the requested stretch"),
        (
            "quality",
            {"line": MAIN, "direction": UP, "band": "D1", "first": "2030-01-01"},
            "no pass",
        ),
        ("nothing", {}, "address does not exist"),
    ],
)
def test_unknown_names_are_answered_with_one_sentence(
    client: httpx.Client, endpoint: str, params: dict[str, str], words: str
) -> None:
    answer = client.get(f"/api/{endpoint}", params=params)
    assert answer.status_code == 404
    assert words in answer.json()["error"]


def test_a_location_that_no_pass_determines_is_refused(client: httpx.Client) -> None:
    parameters = {"line": BRANCH, "direction": DOWN, "band": "D3", "at": "5"}
    answer = client.get("/api/development", params=parameters)
    assert answer.status_code == 422
    assert "the level in D3 is not known: edge" in answer.json()["error"]


def test_a_damaged_store_is_reported_without_its_path(tmp_path, capfd) -> None:
    store = create(str(tmp_path / "damaged"))
    entry = put(store, PassKey("one", "up", FIRST), seen(0, 700.0))
    file = tmp_path / "damaged" / entry.path("overviews")
    file.write_bytes(b"PAR1 is not enough")
    with serving(store) as client:
        parameters = {
            "line": "one",
            "direction": "up",
            "day": str(FIRST),
            "band": "D1",
            "max_bins": "20",
        }
        answer = client.get("/api/level", params=parameters)
        assert client.get("/api/lines").status_code == 200
    assert answer.status_code == 500
    assert "store verify" in answer.json()["error"]
    assert str(tmp_path) not in answer.text
    assert "is damaged" in capfd.readouterr().err


def test_every_endpoint_is_described(client: httpx.Client) -> None:
    described = client.get("/openapi.json").json()
    assert sorted(described["paths"]) == [
        f"/api/{one}"
        for one in (
            "compare", "days", "defects", "development", "level", "lines", "passes", "quality", "schematic", "sections",
        )
    ]  # fmt: skip
    for path in described["paths"].values():
        ((method, one),) = path.items()
        assert method == "get"
        assert one["summary"]
        assert "application/json" in one["responses"]["200"]["content"]
        for parameter in one.get("parameters", ()):
            schema = parameter["schema"]
            kinds = [schema, *schema.get("anyOf", ())]
            bounded = ("maximum", "maxLength", "pattern", "enum", "format", "const")
            assert any(key in kind for kind in kinds for key in bounded), parameter
    assert client.get("/docs").status_code == client.get("/redoc").status_code == 404


def test_every_band_may_be_requested() -> None:
    assert get_args(server_requests.BandName) == tuple(one.name for one in BANDS)
