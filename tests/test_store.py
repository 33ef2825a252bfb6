"""A store keeps each pass once, with the stated precision, and finds it again."""

from __future__ import annotations

import json
import sys
import uuid
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import date, datetime, timedelta
from pathlib import Path

import fsspec
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from narrowing import not_none
from network import SPEED, Network, fill
from trackprofile import store as stores
from trackprofile.assessment.assess import Assessment, assess
from trackprofile.assessment.limits import Action
from trackprofile.assessment.limits_toml import read_limits
from trackprofile.bands import BANDS, band_pass_pieces
from trackprofile.contracts import (
    Quality,
    Rail,
    RailLevel,
    available_rails,
    build_profile,
    content_digest,
    with_rails,
)
from trackprofile.contracts.identity import digest
from trackprofile.errors import DataError, FileError
from trackprofile.positioning.chainage import ChainageTable
from trackprofile.store import Entry, Origin, PassKey, Store
from trackprofile.store.columns import profile_columns
from trackprofile.store.entry import entry_document, entry_id, parse_entry
from trackprofile.store.layout import ENTRIES
from trackprofile.store.object_files import RemoteFiles

DAY = date(2026, 5, 1)
KEY = PassKey("Main / North", "up", DAY, "06:12")
LIMITS = read_limits("en-13848")
NETWORK = Network(1, 600.0, 2)


def assessed(profile: xr.Dataset) -> Assessment:
    """Assessment of a profile, computed once."""
    content = content_digest(profile)
    if content not in _ASSESSMENTS:
        _ASSESSMENTS[content] = assess(profile, LIMITS, SPEED)
    return _ASSESSMENTS[content]


_ASSESSMENTS: dict[str, Assessment] = {}


def add(
    store: Store, profile: xr.Dataset, key: PassKey = KEY, **origin: object
) -> stores.AddResult:
    """Add a profile, with some fields of its origin."""
    fields = {"recording": content_digest(profile)} | origin
    return stores.add(store, key, profile, assessed(profile), Origin(**fields))  # type: ignore[arg-type]


def contents(folder: Path) -> dict[str, bytes]:
    """Content of all files of a store, by path."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="module")
def profile() -> xr.Dataset:
    return NETWORK.passed(0, 0)


@pytest.fixture(scope="module")
def other() -> xr.Dataset:
    return NETWORK.passed(0, 1)


@pytest.fixture(params=["folder", "memory"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Store:
    url = {"folder": str(tmp_path / "store"), "memory": f"memory://{uuid.uuid4()}/store"}
    return stores.create(url[request.param])


def test_a_profile_is_read_with_the_stated_precision(store: Store, profile: xr.Dataset) -> None:
    back = stores.read_profile(store, add(store, profile).entry)
    assert back.attrs == profile.attrs
    assert list(back.variables) == list(profile.variables)
    for name in ("distance", "quality"):
        np.testing.assert_array_equal(back[name], profile[name])
    np.testing.assert_allclose(back["elevation"], profile["elevation"], rtol=0, atol=2.0**-24)
    for name in ("standard_deviation", "standard_deviation_D1", "standard_deviation_D3"):
        np.testing.assert_allclose(back[name], profile[name], rtol=2.0**-11)


def test_both_rails_are_read_with_their_mean(store: Store, profile: xr.Dataset) -> None:
    side = 1e-3 * np.sin(profile["distance"] / 3)
    deviation = np.full(side.size, 1e-4)
    known = profile["elevation"].fillna(0.0)
    separate = with_rails(
        profile.assign(quality=0 * profile["quality"], elevation=known.assign_attrs(units="m")),
        {
            Rail.LEFT: RailLevel(known + side, deviation, {"D1": deviation / 2}),
            Rail.RIGHT: RailLevel(known - side, deviation),
        },
    )
    entry = add(store, separate).entry
    back = stores.read_profile(store, entry)
    assert list(back.variables) == list(separate.variables)
    for name in separate.data_vars:
        np.testing.assert_allclose(back[name], separate[name], rtol=2.0**-11, atol=2.0**-24)
        assert back[name].dtype == separate[name].dtype
    assert available_rails(back) == tuple(Rail)
    envelope = stores.envelope(store, entry, "elevation_left", 0.0, 600.0, 40)
    assert envelope.low.min() == back["elevation_left"].min()
    assert envelope.deviation.max() == pytest.approx(1e-4, rel=2.0**-11)


def test_an_attribute_that_is_not_text_or_numbers_is_refused(
    store: Store, profile: xr.Dataset
) -> None:
    with pytest.raises(DataError, match="Attribute 'when': expected text or numbers"):
        add(store, profile.assign_attrs(when=DAY))
    numbers = profile.assign_attrs(count=np.int64(3), values=np.array([1.5, 2.5]), flag=True)
    back = stores.read_profile(store, add(store, numbers).entry)
    assert (back.attrs["count"], back.attrs["values"], back.attrs["flag"]) == (3, [1.5, 2.5], True)


def test_a_variable_that_is_not_in_metres_is_refused(store: Store, profile: xr.Dataset) -> None:
    with_speed = profile.assign(speed=profile["elevation"].assign_attrs(units="m/s"))
    with pytest.raises(
        DataError, match="speed: a store keeps variables in metres along the profile, and flags"
    ):
        add(store, with_speed)


@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(1e-9, 1e5), begin=st.floats(-1e6, 1e6))
@settings(max_examples=15, deadline=None)
def test_values_that_were_read_from_a_store_are_stored_exactly(
    seed: int, scale: float, begin: float
) -> None:
    generator = np.random.default_rng(seed)
    flags = np.where(generator.random(150) < 0.02, Quality.GAP, 0)
    level = np.where(flags, np.nan, scale * generator.standard_normal(150))
    deviation = scale * generator.random(150) * (generator.random(150) < 0.9)
    first = build_profile(
        begin + 0.25 * np.arange(150),
        level,
        kind="posterior",
        standard_deviation=deviation,
        quality=flags,
    )
    once = through_columns(first)
    twice = through_columns(once)
    xr.testing.assert_identical(once, twice)
    np.testing.assert_allclose(once["elevation"], level, rtol=2.0**-50, atol=2.0**-24)
    np.testing.assert_allclose(once["standard_deviation"], deviation, rtol=2.0**-11, atol=1e-38)


def through_columns(profile: xr.Dataset) -> xr.Dataset:
    columns = profile_columns(profile, {})
    return build_profile(
        columns["distance_m"],
        columns["elevation_m"],
        kind="posterior",
        standard_deviation=columns["standard_deviation_m"],
        quality=columns["quality"],
    )


def test_the_stored_level_in_each_band_is_the_filtered_elevation(
    store: Store, profile: xr.Dataset
) -> None:
    entry = add(store, profile).entry
    kept = stores.read_columns(store, entry, ["level_D1_m", "level_D2_m"])
    for band in BANDS[:2]:
        filtered = band_pass_pieces(profile["elevation"].to_numpy(), 0.25, band)
        np.testing.assert_allclose(
            kept[f"level_{band.name}_m"], filtered, rtol=0, atol=2.0**-24 + 1e-9
        )


def test_uneven_distances_are_kept(store: Store) -> None:
    distance = 0.25 * np.arange(2400) + np.random.default_rng(3).uniform(0.0, 0.1, 2400)
    wave = 1e-3 * np.sin(2 * np.pi * distance / 10)
    uneven = build_profile(distance, wave, kind="point")
    entry = add(store, uneven).entry
    kept = stores.read_columns(store, entry, ["distance_m", "level_D1_m"])
    np.testing.assert_array_equal(kept["distance_m"], distance)
    inner = slice(200, -200)
    assert np.nanmax(np.abs(kept["level_D1_m"] - wave)[inner]) < 5e-5


@given(ends=st.tuples(st.floats(-50, 650), st.floats(-50, 650)).map(sorted))
@settings(max_examples=30, deadline=None)
def test_a_stretch_equals_that_part_of_the_whole_profile(small: Store, ends: list[float]) -> None:
    entry, start, end = stores.find(small)[0], *ends
    whole = stores.read_profile(small, entry)
    inside = (whole["distance"] >= start) & (whole["distance"] <= end)
    if inside.sum() < 2:
        with pytest.raises(DataError, match="choose a stretch inside it"):
            stores.read_profile(small, entry, start, end)
        return
    piece = stores.read_profile(small, entry, start, end)
    for name in whole.variables:
        np.testing.assert_array_equal(piece[name], whole[name][inside.to_numpy()])


def test_a_kilometre_is_read_without_the_rest_of_the_file(tmp_path: Path) -> None:
    store = stores.create(str(tmp_path))
    entry = add(store, Network(1, 8000.0, 1).passed(0, 0)).entry
    path = entry.path("profiles")
    content = bytearray(store.files.read(path))
    content[1000:150_000] = bytes(149_000)  # the first kilometres
    store.files.put(path, bytes(content))
    piece = stores.read_profile(store, entry, 7000.0, 8000.0)
    assert piece.sizes["distance"] == 4001
    with pytest.raises(FileError, match="is damaged; run trackprofile store verify"):
        stores.read_profile(store, entry, 1000.0, 2000.0)


def test_adding_a_pass_twice_gives_one_entry(store: Store, profile: xr.Dataset) -> None:
    first = add(store, profile, source="run.nc")
    second = add(store, profile, source="a copy of run.nc")
    assert (first.new, second.new) == (True, False)
    assert second.entry == first.entry
    assert stores.find(store) == (first.entry,)


def test_the_files_do_not_depend_on_time_order_or_folder(tmp_path: Path) -> None:
    first, second = (tmp_path / name for name in ("first", "second"))
    for folder, numbers in ((first, (0, 1)), (second, (1, 0))):
        store = stores.create(str(folder))
        for number in numbers:
            add(store, NETWORK.passed(0, number), replace(KEY, day=NETWORK.day(number)))
        stores.build_index(store)
    assert contents(first) == contents(second)


def test_another_vehicle_or_software_is_another_version_of_the_pass(
    store: Store, profile: xr.Dataset
) -> None:
    recording = content_digest(profile)
    first = add(store, profile, vehicle="coach", software="0.9.1").entry
    later = add(store, profile, vehicle="coach", software="0.10.0")
    old = add(store, profile, vehicle="locomotive", software="0.9.0")
    assert (later.shown, old.shown) == (True, False)
    assert stores.find(store) == (later.entry,)
    wanted = add(store, profile, vehicle="locomotive", software="0.9.0", revision=1)
    assert stores.find(store) == (wanted.entry,)
    versions = stores.find(store, all_versions=True)
    assert {one.id for one in versions} == {first.id, later.entry.id, old.entry.id, wanted.entry.id}
    assert {one.origin.recording for one in versions} == {recording}
    assert stores.lines(store)[0].passes == 1


def test_a_second_recording_of_a_run_is_refused_and_nothing_is_written(
    tmp_path: Path, profile: xr.Dataset, other: xr.Dataset
) -> None:
    store = stores.create(str(tmp_path / "store"))
    add(store, profile, source="first.nc")
    before = contents(tmp_path)
    with pytest.raises(
        DataError, match=r"has another recording \(first.nc\) of 600 m of this track"
    ):
        add(store, other)
    assert contents(tmp_path) == before
    assert add(store, other, replace(KEY, run="07:12")).new
    assert add(store, other, replace(KEY, direction="down")).new


def test_consecutive_recordings_of_a_run_may_overlap(store: Store) -> None:
    whole = Network(1, 4000.0, 1).passed(0, 0)
    pieces = [whole.isel(distance=slice(first, first + 8001)) for first in (0, 6000)]  # share 500 m
    assert all(add(store, one).new for one in pieces)
    with pytest.raises(DataError, match="give each pass of a day its own run"):
        add(store, whole.isel(distance=slice(4000, 12001)))


def test_another_stretch_of_a_recording_needs_its_own_run(
    store: Store, profile: xr.Dataset
) -> None:
    recording = content_digest(profile)
    add(store, profile.isel(distance=slice(0, 1200)), recording=recording)
    rest = profile.isel(distance=slice(1200, None))
    with pytest.raises(DataError, match="give the other stretch of the recording its own run"):
        add(store, rest, recording=recording)
    assert add(store, rest, replace(KEY, run="06:12, second part"), recording=recording).new


def test_an_assessment_of_another_profile_is_refused(store: Store, profile: xr.Dataset) -> None:
    piece = profile.isel(distance=slice(0, 1000))
    with pytest.raises(DataError, match="assess the profile that is to be stored"):
        stores.add(store, KEY, profile, assessed(piece), Origin(content_digest(profile)))
    assert stores.find(store) == ()


def test_an_entry_has_the_standard_deviations_gaps_and_defects_of_its_pass(
    store: Store, profile: xr.Dataset
) -> None:
    entry = add(store, profile).entry
    known = profile["quality"].to_numpy() & Quality.GAP == 0
    assert (entry.start, entry.end, entry.points) == (0.0, 600.0, 2401)
    assert entry.known_share == pytest.approx(known.mean())
    deviation = profile["standard_deviation_D2"].to_numpy()
    assert entry.standard_deviations["D2"] == np.median(deviation[known])
    found = assessed(profile)
    assert sum(entry.defects.values()) == sum(
        one.required_action is not None for one in found.defects
    )
    assert entry.notes == found.notes


def test_tables_are_those_of_the_assessment_with_the_pass_in_each_row(store: Store) -> None:
    rough = build_profile(*_dipped(), kind="truth")
    entry = add(store, rough).entry
    found = assessed(rough)
    assert len(found.defects) >= 3
    rows = stores.defects(store, [entry])
    assert rows["peak_m"] == [one.peak for one in found.defects]
    assert rows["height_mm"] == [1e3 * one.height for one in found.defects]
    assert set(zip(rows["line"], rows["direction"], rows["day"], rows["run"], strict=True)) == {
        ("Main / North", "up", DAY, "06:12")
    }
    overlapping = stores.defects(store, [entry], 290.0, 310.0)["peak_m"]
    assert overlapping == [one.peak for one in found.defects if one.end >= 290 and one.start <= 310]
    sections = stores.sections(store, [entry], end=200.0)
    assert set(sections["start_m"]) == {0.0, 100.0, 200.0}
    with pytest.raises(DataError, match="There is no table 'faults'; choose one of defects"):
        stores.read_table(store, [entry], "faults")


def _dipped() -> tuple[np.ndarray, np.ndarray]:
    distance = np.arange(0.0, 600.0, 0.25)
    dips = [np.exp(-0.5 * ((distance - position) / 2) ** 2) for position in (100, 300, 500)]
    return distance, -0.04 * np.sum(dips, axis=0)


def test_tables_of_assessments_with_different_classes_are_combined(store: Store) -> None:
    rough = build_profile(*_dipped(), kind="truth")
    one = add(store, rough).entry
    no_classes = replace(LIMITS, classes=())
    other = stores.add(
        store,
        replace(KEY, run="7"),
        rough,
        assess(rough, no_classes, SPEED),
        Origin(content_digest(rough)),
    ).entry
    rows = stores.sections(store, [one, other])
    assert len({len(column) for column in rows.values()}) == 1
    halves = len(rows["entry"]) // 2
    assert rows["probability_A"][0] is not None
    assert rows["probability_A"][halves:] == [None] * halves


def test_tables_have_kilometres_and_coordinates(store: Store) -> None:
    rough = build_profile(*_dipped(), kind="truth")
    chainage = ChainageTable(
        [0.0, 1000.0], [12.0, 11.0], [0.0, 1000.0], [52.0, 52.01], [13.0, 13.0]
    )
    entry = stores.add(
        store, KEY, rough, assessed(rough), Origin(content_digest(rough)), chainage=chainage
    ).entry
    rows = stores.defects(store, [entry])
    assert rows["peak_kilometre"][0] == pytest.approx(11.9, abs=0.01)
    assert rows["latitude_deg"][0] == pytest.approx(52.001, abs=1e-4)


UNUSUAL_NAMES = (
    "..", "../../etc/passwd", "a/b\\c", "'; DROP TABLE catalogue; --", '"', "$line", "%2e%2e", "*?[x]", "line=other",
    "<script>alert(1)</script>",
    "\u014cigawa \u7dda", "\u00c5", "A\u030a", "a\nb\x00c", " ", "\u202egnikcab", "\U0001f686",
)  # fmt: skip


@pytest.mark.parametrize("name", UNUSUAL_NAMES)
def test_a_name_may_hold_any_characters(tmp_path: Path, profile: xr.Dataset, name: str) -> None:
    store = stores.create(str(tmp_path / "inner" / "store"))
    plain = add(store, profile).entry
    odd = add(store, profile, PassKey(name, name, DAY, name), source=name, vehicle=name).entry
    assert stores.find(store, line=name, direction=name) == (odd,)
    assert stores.find(store, line=KEY.line) == (plain,)
    assert {(one.line, one.direction) for one in stores.lines(store)} == {
        (name, name),
        ("Main / North", "up"),
    }
    assert odd.key == PassKey(name, name, DAY, name)
    assert stores.verify(store) == ()
    assert {path.name for path in tmp_path.iterdir()} == {"inner"}
    assert {path.name for path in (tmp_path / "inner").iterdir()} == {"store"}
    assert stores.sections(store, [odd])["line"][0] == name
    stores.build_index(store)
    assert stores.find(store, line=name) == (odd,)


@given(
    line=st.text(st.characters(codec="utf-8"), min_size=1, max_size=60),
    direction=st.text(min_size=1, max_size=20),
)
@settings(max_examples=50)
def test_different_names_have_different_paths(line: str, direction: str) -> None:
    path = PassKey(line, direction, DAY).path(ENTRIES, 16 * "0" + "-" + 16 * "1")
    parts = path.split("/")
    assert len(parts) == 5
    assert path.isascii()
    assert ".." not in parts
    from urllib.parse import unquote

    assert unquote(parts[1].removeprefix("line=")) == line
    assert unquote(parts[2].removeprefix("direction=")) == direction


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("", "needs the name of its line"),
        ("x" * 201, "shorten it"),
        ("\ud800", "is not valid Unicode text"),
    ],
)
def test_an_invalid_name_is_refused(line: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        PassKey(line, "up", DAY)


def test_a_time_is_refused_as_a_day() -> None:
    with pytest.raises(DataError, match="give its time as the run"):
        PassKey("Main", "up", datetime(2026, 5, 1, 6, 12))


def test_an_identity_that_is_not_a_digest_is_refused() -> None:
    with pytest.raises(DataError, match="64 hexadecimal digits, got 'abc'"):
        Origin("abc")


entry_fields = st.lists(
    st.builds(
        dict,
        line=st.sampled_from(["A", "B"]),
        direction=st.sampled_from(["up", "down"]),
        day=st.integers(0, 5).map(lambda n: DAY + timedelta(days=n)),
        run=st.sampled_from(["", "1"]),
        recording=st.sampled_from(["0" * 64, "1" * 64]),
        revision=st.integers(0, 2),
        software=st.sampled_from(["0.1.0", "0.2.0", "0.10.0"]),
        start=st.integers(0, 5).map(lambda n: 100.0 * n),
    ),
    max_size=15,
)


@given(
    fields=entry_fields,
    line=st.sampled_from([None, "A", "C"]),
    direction=st.sampled_from([None, "up"]),
    days=st.tuples(*2 * [st.none() | st.integers(0, 5).map(lambda n: DAY + timedelta(days=n))]),
    ends=st.tuples(*2 * [st.none() | st.floats(0, 700)]),
    indexed=st.integers(0, 15),
)
@settings(max_examples=25, deadline=None)
def test_find_returns_what_a_search_of_each_entry_returns(
    fields: list[dict],
    line: str | None,
    direction: str | None,
    days: tuple,
    ends: tuple,
    indexed: int,
) -> None:
    store = stores.create(f"memory://{uuid.uuid4()}")
    entries = {}
    for number, one in enumerate(fields):
        key = PassKey(one["line"], one["direction"], one["day"], one["run"])
        origin = Origin(one["recording"], revision=one["revision"], software=one["software"])
        made = Entry(
            id=entry_id(key, origin), key=key, origin=origin, kind="posterior", start=one["start"],
            end=one["start"] + 150, points=10, known_share=1.0, standard_deviations={},
            defects={action.text: 0 for action in Action}, notes=(),
            files={table: stores.StoredFile(1, "0" * 64) for table in stores.DATA},
        )  # fmt: skip
        if made.path(ENTRIES) in entries:
            continue  # in a store the same path always has the same bytes
        entries[made.path(ENTRIES)] = made
        store.files.put(made.path(ENTRIES), entry_document(made))
        if number == indexed:
            stores.build_index(store)
    latest: dict = {}
    for one in entries.values():
        key, rank = (one.key, one.origin.recording), _rank(one)
        latest[key] = max(latest.get(key, rank), rank)
    wanted = {
        path for path, one in entries.items()
        if (line is None or one.line == line) and (direction is None or one.direction == direction)
        and (days[0] is None or one.day >= days[0]) and (days[1] is None or one.day <= days[1])
        and (ends[0] is None or one.end >= ends[0]) and (ends[1] is None or one.start <= ends[1])
    }  # fmt: skip
    criteria = {
        "line": line, "direction": direction, "first": days[0], "last": days[1], "start": ends[0], "end": ends[1],
    }  # fmt: skip
    versions = stores.find(store, **criteria, all_versions=True)
    assert {one.path(ENTRIES) for one in versions} == wanted
    assert len(versions) == len(wanted)
    current = {
        path
        for path in wanted
        if _rank(entries[path]) == latest[entries[path].key, entries[path].origin.recording]
    }
    assert {one.path(ENTRIES) for one in stores.find(store, **criteria)} == current
    current_entries = [
        one for one in entries.values() if _rank(one) == latest[one.key, one.origin.recording]
    ]
    for one in stores.lines(store):
        own = [
            each
            for each in current_entries
            if (each.line, each.direction) == (one.line, one.direction)
        ]
        assert one.passes == len(own)
        assert one.days == tuple(sorted({each.day for each in own}))
        assert (one.start, one.end) == (
            min(each.start for each in own),
            max(each.end for each in own),
        )


def _rank(entry: Entry) -> tuple:
    return entry.origin.revision, [int(part) for part in entry.origin.software.split(".")], entry.id


def test_an_entry_is_read_as_it_was_written(store: Store, profile: xr.Dataset) -> None:
    entry = add(store, profile, speed=44.4, source="Ω.nc").entry
    path = entry.path(ENTRIES)
    assert parse_entry(store.files.read(path), path) == entry
    assert entry_document(entry) == store.files.read(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda body: body | {"schema": 3},
            "the entry has schema 3, this version reads schemas up to 2; update trackprofile",
        ),
        (lambda body: body | {"points": "many"}, "does not have the expected content"),
        (lambda body: body | {"id": "0" * 16 + "-" + "0" * 16}, "does not belong at this path"),
        (
            lambda body: body | {"files": {"../../x": {"size": 1, "sha256": ""}}},
            "does not belong at this path",
        ),
    ],
)
def test_an_invalid_entry_is_refused(
    store: Store, profile: xr.Dataset, change: Callable[[dict], dict], message: str
) -> None:
    path = add(store, profile).entry.path(ENTRIES)
    body = json.loads(store.files.read(path))
    body.pop("checksum")
    body = change(body)
    body["checksum"] = digest(body)
    store.files.put(path, json.dumps(body).encode())
    with pytest.raises(FileError, match=message):
        stores.find(store)


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[" * 100_000, b"null", b"{}", b'{"checksum": NaN, "a": NaN}']
)
def test_a_file_that_is_not_an_entry_is_refused(
    store: Store, profile: xr.Dataset, content: bytes
) -> None:
    path = add(store, profile).entry.path(ENTRIES)
    store.files.put(path, content)
    with pytest.raises(FileError, match="trackprofile store verify"):
        stores.find(store)


def test_create_opens_an_existing_store(tmp_path: Path, profile: xr.Dataset) -> None:
    url = str(tmp_path / "new" / "store")
    with pytest.raises(FileError, match="there is no store at this location; check it"):
        stores.open_store(url)
    store = stores.create(url)
    entry = add(store, profile).entry
    assert (
        stores.find(stores.create(url))
        == stores.find(stores.open_store(f"file://{url}"))
        == (entry,)
    )
    with pytest.raises(FileError, match="the folder is not empty and not a store"):
        stores.create(str(Path(url) / "profiles"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            '{"schema": 3}',
            "the store has schema 3, this version reads schemas up to 2; update trackprofile",
        ),
        ('{"schema": "new"}', "has the schema 'new'; expected 1 to 2"),
        ("[]", "store.json is damaged"),
        ("", "store.json is damaged"),
    ],
)
def test_a_store_of_a_newer_or_invalid_schema_is_refused(
    tmp_path: Path, content: str, message: str
) -> None:
    (tmp_path / "store.json").write_text(content, encoding="utf-8")
    for open_function in (stores.open_store, stores.create):
        with pytest.raises(FileError, match=message):
            open_function(str(tmp_path))
    assert contents(tmp_path) == {"store.json": content.encode()}


def test_a_file_system_of_fsspec_gives_the_same_store_as_a_folder(
    tmp_path: Path, profile: xr.Dataset
) -> None:
    local = stores.create(str(tmp_path / "local"))
    remote = stores.create(str(tmp_path / "remote"))
    files = RemoteFiles(fsspec.filesystem("file"), str(tmp_path / "remote"))
    remote = replace(remote, files=files)
    entries = [add(store, profile).entry for store in (local, remote)]
    assert [stores.build_index(store) for store in (local, remote)] == [
        stores.build_index(local)
    ] * 2
    assert contents(tmp_path / "local") == contents(tmp_path / "remote")
    assert stores.find(remote) == (entries[0],)
    assert stores.read_profile(remote, entries[1], 100.0, 200.0).sizes["distance"] == 401
    remote.files.put(entries[1].path("profiles"), b"half")
    remote.files.put(entries[1].path("profiles").replace("line=", "line=other-"), b"unreferenced")
    assert len(stores.verify(remote)) == 2
    assert stores.clean(remote) == ()
    assert len(stores.clean(remote, timedelta(0))) == 1


def test_a_missing_library_is_reported_with_its_remedy(
    monkeypatch: pytest.MonkeyPatch, store: Store
) -> None:
    from trackprofile.store import catalogue

    catalogue._database.cache_clear()
    monkeypatch.setitem(sys.modules, "duckdb", None)
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(FileError, match=r"pip install 'trackprofile\[network\]'"):
        stores.find(store)
    with pytest.raises(FileError, match=r"s3://bucket: .* pip install 'trackprofile\[network\]'"):
        stores.open_store("s3://bucket")


def test_an_unsupported_url_is_refused() -> None:
    with pytest.raises(FileError, match="no installed library supports this URL"):
        stores.open_store("gopher://old/store")


def test_concurrent_threads_add_and_read(tmp_path: Path) -> None:
    single, shared = (stores.create(str(tmp_path / name)) for name in ("single", "shared"))
    passes = [NETWORK.passed(0, number) for number in range(4)]
    keys = [replace(KEY, day=NETWORK.day(number)) for number in range(4)]
    assessments = [assessed(one) for one in passes]
    origins = [Origin(content_digest(one)) for one in passes]
    for arguments in zip(keys, passes, assessments, origins, strict=True):
        stores.add(single, *arguments)

    def work(seed: int) -> int:
        order = np.random.default_rng(seed).permutation(4)
        for number in order:
            stores.add(shared, keys[number], passes[number], assessments[number], origins[number])
            stores.lines(shared)
        return len(stores.find(shared))

    with ThreadPoolExecutor(6) as pool:
        assert set(pool.map(work, range(6))) == {4}
    assert contents(tmp_path / "single") == contents(tmp_path / "shared")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Store:
    store = stores.create(str(tmp_path_factory.mktemp("network")))
    fill(store, Network(2, 1200.0, 2, recording=600.0))
    return store


def test_a_simulated_network_is_complete(small: Store) -> None:
    lines = stores.lines(small)
    assert [(one.line, one.passes, one.start, one.end) for one in lines] == [
        ("Line 1", 4, 0.0, 1200.0),
        ("Line 2", 4, 0.0, 1200.0),
    ]
    assert stores.verify(small) == ()


def test_duckdb_reads_the_files_directly(small: Store) -> None:
    import duckdb

    files = f"read_parquet('{small.url}/profiles/**/*.parquet', hive_partitioning = true)"
    rows = not_none(
        duckdb.sql(f"SELECT line, count(*) FROM {files} GROUP BY line ORDER BY line")
    ).fetchall()
    assert rows == [("Line 1", 2 * 4802), ("Line 2", 2 * 4802)]
    entry = stores.find(small, line="Line 2")[0]
    names = ("distance_m", "elevation_m", "level_D2_m", "standard_deviation_D1_m", "quality")
    kept = stores.read_columns(small, entry, names)
    other = not_none(
        duckdb.sql(f"SELECT {', '.join(names)} FROM '{small.url}/{entry.path('profiles')}'")
    ).fetchnumpy()
    for name in names:
        read = (
            np.ma.filled(other[name].astype(kept[name].dtype), np.nan)
            if name != "quality"
            else other[name]
        )
        np.testing.assert_array_equal(read, kept[name])
