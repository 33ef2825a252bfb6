"""Stores of schema 1 are read as they are, and a pass of theirs is recognised when its recording is added again."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as parquet
import pytest

from network import SPEED, Network
from trackprofile import store as stores
from trackprofile.assessment.assess import assess
from trackprofile.assessment.limits_toml import read_limits
from trackprofile.contracts import content_digest
from trackprofile.errors import DataError
from trackprofile.store import Entry, Origin, PassKey, Store

NETWORK = Network(1, 600.0, 2)
PROFILE = NETWORK.passed(0, 0)
ASSESSMENT = assess(PROFILE, read_limits("en-13848"), SPEED)
KEY = PassKey("Main / North", "up", date(2026, 5, 1), "06:12")
FINGERPRINT = content_digest(PROFILE)
IDENTITY = 64 * "a"
"""Identity of the recording whose fingerprint is `FINGERPRINT`."""

INDEX_COLUMNS = (
    "path", "size", "entry", "line", "direction", "day", "run", "recording", "start_m", "end_m", "revision",
    "software", "document",
)  # fmt: skip


def document_of_schema_1(entry: Entry) -> bytes:
    """Document of an entry as version 0.1.0 wrote it."""
    origin = {
        name: getattr(entry.origin, name)
        for name in (
            "recording", "source", "vehicle", "method", "track", "prior", "limits", "speed", "settings", "software",
            "revision",
        )
    }  # fmt: skip
    body: dict[str, Any] = {
        "schema": 1,
        "id": entry.id,
        "place": {
            "line": entry.line,
            "direction": entry.direction,
            "day": entry.day.isoformat(),
            "run": entry.run,
        },
        "origin": origin,
        "kind": entry.kind,
        "start": entry.start,
        "end": entry.end,
        "points": entry.points,
        "known": entry.known_share,
        "deviations": entry.standard_deviations,
        "defects": entry.defects,
        "notes": entry.notes,
        "files": {
            name: {"size": one.size, "sha256": one.sha256} for name, one in entry.files.items()
        },
    }
    return _canonical(body | {"checksum": hashlib.sha256(_canonical(body)).hexdigest()}) + b"\n"


def _canonical(body: dict[str, Any]) -> bytes:
    return json.dumps(body, ensure_ascii=True, sort_keys=True, separators=(",", ":")).encode()


def write_index_of_schema_1(folder: Path, entry: Entry, document: bytes) -> None:
    """Index of one entry as version 0.1.0 wrote it."""
    values = (
        entry.path("entries"), len(document), entry.id, entry.line, entry.direction, entry.day, entry.run,
        entry.origin.recording, entry.start, entry.end, 0, "00000000.00000001.00000000", document,
    )  # fmt: skip
    sink = pa.BufferOutputStream()
    columns = {name: [value] for name, value in zip(INDEX_COLUMNS, values, strict=True)}
    parquet.write_table(pa.table(columns), sink)
    content = sink.getvalue().to_pybytes()
    (folder / "index").mkdir()
    name = f"{hashlib.sha256(content).hexdigest()}.parquet"
    (folder / "index" / name).write_bytes(content)


@pytest.fixture(params=["without index", "with index"])
def old_store(request: pytest.FixtureRequest, tmp_path: Path) -> Store:
    """A store of schema 1 with one pass."""
    store = stores.create(str(tmp_path / "store"))
    entry = stores.add(store, KEY, PROFILE, ASSESSMENT, Origin(FINGERPRINT, source="may.nc")).entry
    document = document_of_schema_1(entry)
    store.files.put(entry.path("entries"), document)
    store.files.put("store.json", b'{"schema": 1}\n')
    if request.param == "with index":
        write_index_of_schema_1(tmp_path / "store", entry, document)
    return stores.open_store(store.url)


def test_a_store_of_schema_1_is_read_and_verified(old_store: Store) -> None:
    (entry,) = stores.find(old_store, line=KEY.line, start=100.0, end=200.0)
    assert (entry.schema, entry.key, entry.origin.recording) == (1, KEY, FINGERPRINT)
    assert entry.origin.fingerprint == ""
    assert stores.lines(old_store)[0].passes == 1
    assert stores.read_profile(old_store, entry).sizes == PROFILE.sizes
    assert stores.sections(old_store, [entry])["line"][0] == KEY.line
    assert stores.verify(old_store) == ()
    assert old_store.files.read("store.json") == b'{"schema": 1}\n'


def test_the_same_recording_is_a_new_version_of_the_pass_of_schema_1(old_store: Store) -> None:
    (old,) = stores.find(old_store)
    before = old_store.files.read(old.path("entries"))
    origin = Origin(IDENTITY, fingerprint=FINGERPRINT)
    added = stores.add(old_store, KEY, PROFILE, ASSESSMENT, origin)
    assert (added.new, added.shown) == (True, True)
    assert stores.find(old_store) == (added.entry,)
    versions = stores.find(old_store, all_versions=True)
    assert {one.id for one in versions} == {old.id, added.entry.id}
    assert stores.lines(old_store)[0].passes == 1
    assert old_store.files.read(old.path("entries")) == before
    assert old_store.files.read("store.json") == b'{"schema": 2}\n'
    assert stores.verify(old_store) == ()
    stores.build_index(old_store)
    assert stores.find(old_store) == (added.entry,)
    assert stores.verify(old_store) == ()
    assert not stores.add(old_store, KEY, PROFILE, ASSESSMENT, origin).new


def test_a_pass_that_was_stored_in_the_same_way_is_not_added_again(old_store: Store) -> None:
    """A profile that an earlier version wrote names its recording by the fingerprint."""
    added = stores.add(old_store, KEY, PROFILE, ASSESSMENT, Origin(FINGERPRINT))
    assert (added.new, added.shown) == (False, True)
    assert old_store.files.read("store.json") == b'{"schema": 1}\n'


def test_versions_with_other_estimated_positions_remain_versions_of_one_recording(
    old_store: Store,
) -> None:
    """The fingerprint depends on estimated positions, the identity does not."""
    stores.add(old_store, KEY, PROFILE, ASSESSMENT, Origin(IDENTITY, fingerprint=FINGERPRINT))
    moved = Origin(IDENTITY, fingerprint=64 * "b", revision=1)
    latest = stores.add(old_store, KEY, PROFILE, ASSESSMENT, moved).entry
    assert stores.find(old_store) == (latest,)
    assert len(stores.find(old_store, all_versions=True)) == 3
    assert stores.verify(old_store) == ()


def test_another_recording_of_the_same_run_is_refused_with_the_remedy(old_store: Store) -> None:
    (old,) = stores.find(old_store)
    other = NETWORK.passed(0, 1)
    assessment = assess(other, read_limits("en-13848"), SPEED)
    for origin in (Origin(IDENTITY), Origin(IDENTITY, fingerprint=content_digest(other))):
        with pytest.raises(DataError, match=r"another recording \(may.nc\).*schema 1") as refused:
            stores.add(old_store, KEY, other, assessment, origin)
        assert f"remove {old.path('entries')} and add the pass again" in str(refused.value)
    assert old_store.files.read("store.json") == b'{"schema": 1}\n'
    assert stores.add(old_store, replace(KEY, run="07:12"), other, assessment, Origin(IDENTITY)).new
