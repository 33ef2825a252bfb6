"""A store keeps every pass as it was, once, and finds it again."""

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

from network import SPEED, Network, fill
from trackprofile import store as stores
from trackprofile.assessment.assess import Assessment, assess
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
from trackprofile.errors import DataError, FileError
from trackprofile.positioning.chainage import ChainageTable
from trackprofile.store import Entry, Origin, PassKey, Store
from trackprofile.store.columns import profile_columns
from trackprofile.store.entry import document, entry_id, parsed
from trackprofile.store.layout import ENTRIES
from trackprofile.store.object_files import RemoteFiles

DAY = date(2026, 5, 1)
PLACE = PassKey("Main / North", "up", DAY, "06:12")
LIMITS = read_limits("en-13848")
NETWORK = Network(1, 600.0, 2)


def judged(profile: xr.Dataset) -> Assessment:
    """By the limits, each profile once."""
    key = content_digest(profile)
    if key not in _JUDGED:
        _JUDGED[key] = assess(profile, LIMITS, SPEED)
    return _JUDGED[key]


_JUDGED: dict[str, Assessment] = {}


def stored(
    store: Store, profile: xr.Dataset, place: PassKey = PLACE, **origin: object
) -> stores.AddResult:
    made = Origin(**({"recording": content_digest(profile)} | origin))  # type: ignore[arg-type]
    return stores.add(store, place, profile, judged(profile), made)


def tree(folder: Path) -> dict[str, bytes]:
    """All files of a store, by name."""
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
    where = {"folder": str(tmp_path / "store"), "memory": f"memory://{uuid.uuid4()}/store"}
    return stores.create(where[request.param])


def test_a_profile_comes_back_as_exactly_as_is_stated(store: Store, profile: xr.Dataset) -> None:
    back = stores.read_profile(store, stored(store, profile).entry)
    assert back.attrs == profile.attrs
    assert list(back.variables) == list(profile.variables)
    for name in ("distance", "quality"):
        np.testing.assert_array_equal(back[name], profile[name])
    np.testing.assert_allclose(back["elevation"], profile["elevation"], rtol=0, atol=2.0**-24)
    for name in ("standard_deviation", "standard_deviation_D1", "standard_deviation_D3"):
        np.testing.assert_allclose(back[name], profile[name], rtol=2.0**-11)


def test_both_rails_come_back_beside_their_mean(store: Store, profile: xr.Dataset) -> None:
    side = 1e-3 * np.sin(profile["distance"] / 3)
    spread = np.full(side.size, 1e-4)
    known = profile["elevation"].fillna(0.0)
    apart = with_rails(
        profile.assign(quality=0 * profile["quality"], elevation=known.assign_attrs(units="m")),
        {
            Rail.LEFT: RailLevel(known + side, spread, {"D1": spread / 2}),
            Rail.RIGHT: RailLevel(known - side, spread),
        },
    )
    entry = stored(store, apart).entry
    back = stores.read_profile(store, entry)
    assert list(back.variables) == list(apart.variables)
    for name in apart.data_vars:
        np.testing.assert_allclose(back[name], apart[name], rtol=2.0**-11, atol=2.0**-24)
        assert back[name].dtype == apart[name].dtype
    assert available_rails(back) == tuple(Rail)
    drawn = stores.envelope(store, entry, "elevation_left", 0.0, 600.0, 40)
    assert drawn.low.min() == back["elevation_left"].min()
    assert drawn.deviation.max() == pytest.approx(1e-4, rel=2.0**-11)


def test_an_attribute_that_no_file_can_hold_is_refused(store: Store, profile: xr.Dataset) -> None:
    with pytest.raises(DataError, match="Attribute 'when': expected text or numbers"):
        stored(store, profile.assign_attrs(when=DAY))
    numbers = profile.assign_attrs(count=np.int64(3), places=np.array([1.5, 2.5]), sure=True)
    back = stores.read_profile(store, stored(store, numbers).entry)
    assert (back.attrs["count"], back.attrs["places"], back.attrs["sure"]) == (3, [1.5, 2.5], True)


def test_what_no_column_can_hold_is_refused(store: Store, profile: xr.Dataset) -> None:
    strange = profile.assign(speed=profile["elevation"].assign_attrs(units="m/s"))
    with pytest.raises(
        DataError, match="speed: a store keeps what is in metres along a profile, and flags"
    ):
        stored(store, strange)


@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(1e-9, 1e5), begin=st.floats(-1e6, 1e6))
@settings(max_examples=15, deadline=None)
def test_whatever_the_numbers_what_was_read_is_kept_to_the_bit(
    seed: int, scale: float, begin: float
) -> None:
    generator = np.random.default_rng(seed)
    flags = np.where(generator.random(150) < 0.02, Quality.GAP, 0)
    level = np.where(flags, np.nan, scale * generator.standard_normal(150))
    spread = scale * generator.random(150) * (generator.random(150) < 0.9)
    first = build_profile(
        begin + 0.25 * np.arange(150),
        level,
        kind="posterior",
        standard_deviation=spread,
        quality=flags,
    )
    once = _kept(first)
    twice = _kept(once)
    xr.testing.assert_identical(once, twice)
    np.testing.assert_allclose(once["elevation"], level, rtol=2.0**-50, atol=2.0**-24)
    np.testing.assert_allclose(once["standard_deviation"], spread, rtol=2.0**-11, atol=1e-38)


def _kept(profile: xr.Dataset) -> xr.Dataset:
    columns = profile_columns(profile, {})
    return build_profile(
        columns["distance_m"],
        columns["elevation_m"],
        kind="posterior",
        standard_deviation=columns["standard_deviation_m"],
        quality=columns["quality"],
    )


def test_the_level_in_each_band_is_the_filters(store: Store, profile: xr.Dataset) -> None:
    entry = stored(store, profile).entry
    kept = stores.read_columns(store, entry, ["level_D1_m", "level_D2_m"])
    for band in BANDS[:2]:
        filtered = band_pass_pieces(profile["elevation"].to_numpy(), 0.25, band)
        np.testing.assert_allclose(
            kept[f"level_{band.name}_m"], filtered, rtol=0, atol=2.0**-24 + 1e-9
        )


def test_rows_at_uneven_distances_keep_theirs(store: Store) -> None:
    distance = 0.25 * np.arange(2400) + np.random.default_rng(3).uniform(0.0, 0.1, 2400)
    wave = 1e-3 * np.sin(2 * np.pi * distance / 10)
    uneven = build_profile(distance, wave, kind="point")
    entry = stored(store, uneven).entry
    kept = stores.read_columns(store, entry, ["distance_m", "level_D1_m"])
    np.testing.assert_array_equal(kept["distance_m"], distance)
    inner = slice(200, -200)
    assert np.nanmax(np.abs(kept["level_D1_m"] - wave)[inner]) < 5e-5


@given(ends=st.tuples(st.floats(-50, 650), st.floats(-50, 650)).map(sorted))
@settings(max_examples=30, deadline=None)
def test_a_stretch_is_what_the_whole_has_there(small: Store, ends: list[float]) -> None:
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


def test_one_kilometre_is_read_without_the_rest(tmp_path: Path) -> None:
    store = stores.create(str(tmp_path))
    entry = stored(store, Network(1, 8000.0, 1).passed(0, 0)).entry
    path = entry.path("profiles")
    content = bytearray(store.files.read(path))
    content[1000:150_000] = bytes(149_000)  # the first kilometres
    store.files.put(path, bytes(content))
    piece = stores.read_profile(store, entry, 7000.0, 8000.0)
    assert piece.sizes["distance"] == 4001
    with pytest.raises(FileError, match="is damaged; see what"):
        stores.read_profile(store, entry, 1000.0, 2000.0)


def test_the_same_again_is_the_same_entry(store: Store, profile: xr.Dataset) -> None:
    first = stored(store, profile, source="run.nc")
    again = stored(store, profile, source="a copy of run.nc")
    assert (first.new, again.new) == (True, False)
    assert again.entry == first.entry
    assert stores.find(store) == (first.entry,)


def test_nothing_in_the_bytes_tells_when_or_where_they_were_written(tmp_path: Path) -> None:
    once, again = (tmp_path / name for name in ("once", "again"))
    for folder, numbers in ((once, (0, 1)), (again, (1, 0))):
        store = stores.create(str(folder))
        for number in numbers:
            stored(store, NETWORK.passed(0, number), replace(PLACE, day=NETWORK.day(number)))
        stores.build_index(store)
    assert tree(once) == tree(again)


def test_another_vehicle_is_a_version_beside(store: Store, profile: xr.Dataset) -> None:
    recording = content_digest(profile)
    first = stored(store, profile, vehicle="coach", software="0.9.1").entry
    later = stored(store, profile, vehicle="coach", software="0.10.0")
    old = stored(store, profile, vehicle="locomotive", software="0.9.0")
    assert (later.shown, old.shown) == (True, False)
    assert stores.find(store) == (later.entry,)
    wanted = stored(store, profile, vehicle="locomotive", software="0.9.0", revision=1)
    assert stores.find(store) == (wanted.entry,)
    every = stores.find(store, all_versions=True)
    assert {one.id for one in every} == {first.id, later.entry.id, old.entry.id, wanted.entry.id}
    assert {one.origin.recording for one in every} == {recording}
    assert stores.lines(store)[0].passes == 1


def test_a_second_recording_of_a_run_is_refused_and_nothing_written(
    tmp_path: Path, profile: xr.Dataset, other: xr.Dataset
) -> None:
    store = stores.create(str(tmp_path / "store"))
    stored(store, profile, source="first.nc")
    before = tree(tmp_path)
    with pytest.raises(
        DataError, match=r"has another recording \(first.nc\) of 600 m of this track"
    ):
        stored(store, other)
    assert tree(tmp_path) == before
    assert stored(store, other, replace(PLACE, run="07:12")).new
    assert stored(store, other, replace(PLACE, direction="down")).new


def test_recordings_of_a_run_may_share_their_ends(store: Store) -> None:
    whole = Network(1, 4000.0, 1).passed(0, 0)
    pieces = [whole.isel(distance=slice(first, first + 8001)) for first in (0, 6000)]  # share 500 m
    assert all(stored(store, one).new for one in pieces)
    with pytest.raises(DataError, match="give each pass of a day its run"):
        stored(store, whole.isel(distance=slice(4000, 12001)))


def test_another_stretch_of_a_recording_needs_a_run_of_its_own(
    store: Store, profile: xr.Dataset
) -> None:
    recording = content_digest(profile)
    stored(store, profile.isel(distance=slice(0, 1200)), recording=recording)
    rest = profile.isel(distance=slice(1200, None))
    with pytest.raises(DataError, match="give the other stretch of the recording a run of its own"):
        stored(store, rest, recording=recording)
    assert stored(store, rest, replace(PLACE, run="06:12, second part"), recording=recording).new


def test_an_assessment_of_another_profile_is_refused(store: Store, profile: xr.Dataset) -> None:
    piece = profile.isel(distance=slice(0, 1000))
    with pytest.raises(DataError, match="assess the profile that is to be stored"):
        stores.add(store, PLACE, profile, judged(piece), Origin(content_digest(profile)))
    assert stores.find(store) == ()


def test_the_catalogue_tells_how_well_a_pass_is_known(store: Store, profile: xr.Dataset) -> None:
    entry = stored(store, profile).entry
    known = profile["quality"].to_numpy() & Quality.GAP == 0
    assert (entry.start, entry.end, entry.points) == (0.0, 600.0, 2401)
    assert entry.known == pytest.approx(known.mean())
    spread = profile["standard_deviation_D2"].to_numpy()
    assert entry.deviations["D2"] == np.median(spread[known])
    found = judged(profile)
    assert sum(entry.defects.values()) == sum(one.likely is not None for one in found.defects)
    assert entry.notes == found.notes


def test_tables_are_the_assessments_with_their_place(store: Store) -> None:
    rough = build_profile(*_dipped(), kind="truth")
    entry = stored(store, rough).entry
    found = judged(rough)
    assert len(found.defects) >= 3
    rows = stores.defects(store, [entry])
    assert rows["peak_m"] == [one.peak for one in found.defects]
    assert rows["height_mm"] == [1e3 * one.height for one in found.defects]
    assert set(zip(rows["line"], rows["direction"], rows["day"], rows["run"], strict=True)) == {
        ("Main / North", "up", DAY, "06:12")
    }
    touched = stores.defects(store, [entry], 290.0, 310.0)["peak_m"]
    assert touched == [one.peak for one in found.defects if one.end >= 290 and one.start <= 310]
    sections = stores.sections(store, [entry], end=200.0)
    assert set(sections["start_m"]) == {0.0, 100.0, 200.0}
    with pytest.raises(DataError, match="There is no table 'faults'; choose one of defects"):
        stores.table(store, [entry], "faults")


def _dipped() -> tuple[np.ndarray, np.ndarray]:
    distance = np.arange(0.0, 600.0, 0.25)
    dips = [np.exp(-0.5 * ((distance - place) / 2) ** 2) for place in (100, 300, 500)]
    return distance, -0.04 * np.sum(dips, axis=0)


def test_tables_of_passes_judged_by_different_classes_stand_together(store: Store) -> None:
    rough = build_profile(*_dipped(), kind="truth")
    one = stored(store, rough).entry
    no_classes = replace(LIMITS, classes=())
    other = stores.add(
        store,
        replace(PLACE, run="7"),
        rough,
        assess(rough, no_classes, SPEED),
        Origin(content_digest(rough)),
    ).entry
    rows = stores.sections(store, [one, other])
    assert len({len(column) for column in rows.values()}) == 1
    halves = len(rows["entry"]) // 2
    assert rows["probability_A"][0] is not None
    assert rows["probability_A"][halves:] == [None] * halves


def test_kilometres_and_coordinates_stand_in_the_tables(store: Store) -> None:
    rough = build_profile(*_dipped(), kind="truth")
    way = ChainageTable([0.0, 1000.0], [12.0, 11.0], [0.0, 1000.0], [52.0, 52.01], [13.0, 13.0])
    entry = stores.add(
        store, PLACE, rough, judged(rough), Origin(content_digest(rough)), way=way
    ).entry
    rows = stores.defects(store, [entry])
    assert rows["peak_kilometre"][0] == pytest.approx(11.9, abs=0.01)
    assert rows["latitude_deg"][0] == pytest.approx(52.001, abs=1e-4)


NASTY = (
    "..", "../../etc/passwd", "a/b\\c", "'; DROP TABLE catalogue; --", '"', "$line", "%2e%2e", "*?[x]", "line=other",
    "<script>alert(1)</script>",
    "\u014cigawa \u7dda", "\u00c5", "A\u030a", "a\nb\x00c", " ", "\u202egnikcab", "\U0001f686",
)  # fmt: skip


@pytest.mark.parametrize("name", NASTY)
def test_a_name_is_data_whatever_it_says(tmp_path: Path, profile: xr.Dataset, name: str) -> None:
    store = stores.create(str(tmp_path / "inner" / "store"))
    plain = stored(store, profile).entry
    odd = stored(store, profile, PassKey(name, name, DAY, name), source=name, vehicle=name).entry
    assert stores.find(store, line=name, direction=name) == (odd,)
    assert stores.find(store, line=PLACE.line) == (plain,)
    assert {(one.line, one.direction) for one in stores.lines(store)} == {
        (name, name),
        ("Main / North", "up"),
    }
    assert odd.place == PassKey(name, name, DAY, name)
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
def test_no_two_names_have_one_path(line: str, direction: str) -> None:
    path = PassKey(line, direction, DAY).path(ENTRIES, 16 * "0" + "-" + 16 * "1")
    parts = path.split("/")
    assert len(parts) == 5
    assert path.isascii()
    assert ".." not in parts
    from urllib.parse import unquote

    assert unquote(parts[1].removeprefix("line=")) == line
    assert unquote(parts[2].removeprefix("direction=")) == direction


@pytest.mark.parametrize(
    ("line", "said"),
    [("", "needs the name of its line"), ("x" * 201, "shorten it"), ("\ud800", "is no text")],
)
def test_a_name_that_no_path_can_hold_is_refused(line: str, said: str) -> None:
    with pytest.raises(DataError, match=said):
        PassKey(line, "up", DAY)


def test_a_time_is_no_day() -> None:
    with pytest.raises(DataError, match="its time is its run"):
        PassKey("Main", "up", datetime(2026, 5, 1, 6, 12))


def test_a_recording_is_named_by_a_whole_hash() -> None:
    with pytest.raises(DataError, match="64 hexadecimal digits, got 'abc'"):
        Origin("abc")


entries_drawn = st.lists(
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
    drawn=entries_drawn,
    line=st.sampled_from([None, "A", "C"]),
    direction=st.sampled_from([None, "up"]),
    days=st.tuples(*2 * [st.none() | st.integers(0, 5).map(lambda n: DAY + timedelta(days=n))]),
    ends=st.tuples(*2 * [st.none() | st.floats(0, 700)]),
    indexed=st.integers(0, 15),
)
@settings(max_examples=25, deadline=None)
def test_find_is_what_looking_at_each_entry_finds(
    drawn: list[dict],
    line: str | None,
    direction: str | None,
    days: tuple,
    ends: tuple,
    indexed: int,
) -> None:
    store = stores.create(f"memory://{uuid.uuid4()}")
    entries = {}
    for number, one in enumerate(drawn):
        place = PassKey(one["line"], one["direction"], one["day"], one["run"])
        origin = Origin(one["recording"], revision=one["revision"], software=one["software"])
        made = Entry(
            entry_id(place, origin), place, origin, "posterior", one["start"], one["start"] + 150, 10, 1.0, {},
            {"alert": 0, "intervention": 0, "immediate action": 0}, (),
            {table: stores.StoredFile(1, "0" * 64) for table in stores.DATA},
        )  # fmt: skip
        if made.path(ENTRIES) in entries:
            continue  # the same name always has the same bytes: nothing in a store is written over by others
        entries[made.path(ENTRIES)] = made
        store.files.put(made.path(ENTRIES), document(made))
        if number == indexed:
            stores.build_index(store)
    latest: dict = {}
    for one in entries.values():
        key, rank = (one.place, one.origin.recording), _rank(one)
        latest[key] = max(latest.get(key, rank), rank)
    wanted = {
        path for path, one in entries.items()
        if (line is None or one.line == line) and (direction is None or one.direction == direction)
        and (days[0] is None or one.day >= days[0]) and (days[1] is None or one.day <= days[1])
        and (ends[0] is None or one.end >= ends[0]) and (ends[1] is None or one.start <= ends[1])
    }  # fmt: skip
    asked = {
        "line": line, "direction": direction, "first": days[0], "last": days[1], "start": ends[0], "end": ends[1],
    }  # fmt: skip
    every = stores.find(store, **asked, all_versions=True)
    assert {one.path(ENTRIES) for one in every} == wanted
    assert len(every) == len(wanted)
    newest = {
        path
        for path in wanted
        if _rank(entries[path]) == latest[entries[path].place, entries[path].origin.recording]
    }
    assert {one.path(ENTRIES) for one in stores.find(store, **asked)} == newest
    there = [
        one for one in entries.values() if _rank(one) == latest[one.place, one.origin.recording]
    ]
    for one in stores.lines(store):
        own = [each for each in there if (each.line, each.direction) == (one.line, one.direction)]
        assert one.passes == len(own)
        assert one.days == tuple(sorted({each.day for each in own}))
        assert (one.start, one.end) == (
            min(each.start for each in own),
            max(each.end for each in own),
        )


def _rank(entry: Entry) -> tuple:
    return entry.origin.revision, [int(part) for part in entry.origin.software.split(".")], entry.id


def test_an_entry_is_read_as_it_was_written(store: Store, profile: xr.Dataset) -> None:
    entry = stored(store, profile, speed=44.4, source="Ω.nc").entry
    path = entry.path(ENTRIES)
    assert parsed(store.files.read(path), path) == entry
    assert document(entry) == store.files.read(path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda body: body | {"schema": 2},
            "an entry of schema 2, this version knows up to 1; update it",
        ),
        (lambda body: body | {"points": "many"}, "not an entry as this version knows it"),
        (lambda body: body | {"id": "0" * 16 + "-" + "0" * 16}, "does not belong there"),
        (
            lambda body: body | {"files": {"../../x": {"size": 1, "sha256": ""}}},
            "does not belong there",
        ),
    ],
)
def test_an_entry_that_is_none_is_refused(
    store: Store, profile: xr.Dataset, change: Callable[[dict], dict], said: str
) -> None:
    from trackprofile.store import entry as entries

    path = stored(store, profile).entry.path(ENTRIES)
    body = json.loads(store.files.read(path))
    body.pop("checksum")
    body = change(body)
    body["checksum"] = entries._digest(body)
    store.files.put(path, json.dumps(body).encode())
    with pytest.raises(FileError, match=said):
        stores.find(store)


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[" * 100_000, b"null", b"{}", b'{"checksum": NaN, "a": NaN}']
)
def test_what_is_no_entry_at_all_is_refused(
    store: Store, profile: xr.Dataset, content: bytes
) -> None:
    path = stored(store, profile).entry.path(ENTRIES)
    store.files.put(path, content)
    with pytest.raises(FileError, match="trackprofile store verify"):
        stores.find(store)


def test_a_store_is_made_once_and_opened_ever_after(tmp_path: Path, profile: xr.Dataset) -> None:
    url = str(tmp_path / "new" / "store")
    with pytest.raises(FileError, match="there is no store; check the place"):
        stores.open_store(url)
    store = stores.create(url)
    entry = stored(store, profile).entry
    assert (
        stores.find(stores.create(url))
        == stores.find(stores.open_store(f"file://{url}"))
        == (entry,)
    )
    with pytest.raises(FileError, match="the folder is no store and not empty"):
        stores.create(str(Path(url) / "profiles"))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ('{"schema": 2}', "a store of schema 2, this version knows up to 1; update trackprofile"),
        ('{"schema": "new"}', "states schema 'new'; expected 1"),
        ("[]", "store.json is damaged"),
        ("", "store.json is damaged"),
    ],
)
def test_a_store_of_another_schema_is_left_alone(tmp_path: Path, content: str, said: str) -> None:
    (tmp_path / "store.json").write_text(content, encoding="utf-8")
    for opened in (stores.open_store, stores.create):
        with pytest.raises(FileError, match=said):
            opened(str(tmp_path))
    assert tree(tmp_path) == {"store.json": content.encode()}


def test_any_file_system_of_fsspec_holds_what_a_folder_does(
    tmp_path: Path, profile: xr.Dataset
) -> None:
    here = stores.create(str(tmp_path / "here"))
    there = stores.create(str(tmp_path / "there"))
    there = replace(there, files=RemoteFiles(fsspec.filesystem("file"), str(tmp_path / "there")))
    entries = [stored(store, profile).entry for store in (here, there)]
    assert [stores.build_index(store) for store in (here, there)] == [stores.build_index(here)] * 2
    assert tree(tmp_path / "here") == tree(tmp_path / "there")
    assert stores.find(there) == (entries[0],)
    assert stores.read_profile(there, entries[1], 100.0, 200.0).sizes["distance"] == 401
    there.files.put(entries[1].path("profiles"), b"half")
    there.files.put(entries[1].path("profiles").replace("line=", "line=other-"), b"nobody's")
    assert len(stores.verify(there)) == 2
    assert stores.clean(there) == ()
    assert len(stores.clean(there, timedelta(0))) == 1


def test_a_missing_library_is_named_with_its_remedy(
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


def test_a_url_that_nothing_reaches_is_refused() -> None:
    with pytest.raises(FileError, match="no library here reaches that"):
        stores.open_store("gopher://old/store")


def test_many_may_add_and_read_at_once(tmp_path: Path) -> None:
    alone, shared = (stores.create(str(tmp_path / name)) for name in ("alone", "shared"))
    passes = [NETWORK.passed(0, number) for number in range(4)]
    places = [replace(PLACE, day=NETWORK.day(number)) for number in range(4)]
    found = [judged(one) for one in passes]
    origins = [Origin(content_digest(one)) for one in passes]
    for made in zip(places, passes, found, origins, strict=True):
        stores.add(alone, *made)

    def work(seed: int) -> int:
        order = np.random.default_rng(seed).permutation(4)
        for number in order:
            stores.add(shared, places[number], passes[number], found[number], origins[number])
            stores.lines(shared)
        return len(stores.find(shared))

    with ThreadPoolExecutor(6) as pool:
        assert set(pool.map(work, range(6))) == {4}
    assert tree(tmp_path / "alone") == tree(tmp_path / "shared")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Store:
    store = stores.create(str(tmp_path_factory.mktemp("network")))
    fill(store, Network(2, 1200.0, 2, recording=600.0))
    return store


def test_a_simulated_network_is_whole(small: Store) -> None:
    there = stores.lines(small)
    assert [(one.line, one.passes, one.start, one.end) for one in there] == [
        ("Line 1", 4, 0.0, 1200.0),
        ("Line 2", 4, 0.0, 1200.0),
    ]
    assert stores.verify(small) == ()


def test_duckdb_reads_the_files_in_place(small: Store) -> None:
    import duckdb

    files = f"read_parquet('{small.url}/profiles/**/*.parquet', hive_partitioning = true)"
    rows = duckdb.sql(f"SELECT line, count(*) FROM {files} GROUP BY line ORDER BY line").fetchall()
    assert rows == [("Line 1", 2 * 4802), ("Line 2", 2 * 4802)]
    entry = stores.find(small, line="Line 2")[0]
    names = ("distance_m", "elevation_m", "level_D2_m", "standard_deviation_D1_m", "quality")
    kept = stores.read_columns(small, entry, names)
    other = duckdb.sql(
        f"SELECT {', '.join(names)} FROM '{small.url}/{entry.path('profiles')}'"
    ).fetchnumpy()
    for name in names:
        read = (
            np.ma.filled(other[name].astype(kept[name].dtype), np.nan)
            if name != "quality"
            else other[name]
        )
        np.testing.assert_array_equal(read, kept[name])
