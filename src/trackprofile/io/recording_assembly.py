"""From a TOML document and the table that it describes to a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import xarray as xr

from trackprofile.contracts import build_recording
from trackprofile.io import table
from trackprofile.io.recording_clock import on_one_clock
from trackprofile.io.recording_columns import (
    MOTION_DIMENSIONS,
    channel_name,
    plan_columns,
    read_raw_tables,
    signals,
)
from trackprofile.io.recording_document import RecordingDocument
from trackprofile.io.recording_identity import TEXTS, file_identity
from trackprofile.io.recording_position import has_position_sources, position_sources
from trackprofile.io.unlocated_recording import UnlocatedRecording
from trackprofile.preprocessing.clock import REPAIR_PREFIX


def assemble_recording(
    description: Path, data: Path, document: RecordingDocument
) -> xr.Dataset | UnlocatedRecording:
    """Recording that the document in the file ``description`` describes in the table ``data``.

    Returns
    -------
    a recording; an `UnlocatedRecording` where its positions have to be estimated from position sources

    Raises
    ------
    DataError : a column, unit or value cannot be used; the message names it.
    """
    head = document.recording
    plan = plan_columns(description, data, document)
    raw = read_raw_tables(description, data, plan)
    identity = file_identity(document, raw)
    columns = {channel_name(one.column): one.column for one in document.sensor}
    for name in ("time", *MOTION_DIMENSIONS):
        if (reference := getattr(head, name)) is not None:
            columns[name] = reference.column
    read = signals(data, plan, raw.recording)
    with table.error_location(data, columns):
        needs_time = has_position_sources(head)
        clocked = on_one_clock(read, needs_time=needs_time)
        steps = [f"read from {data.name}", *(REPAIR_PREFIX + note for note in clocked.notes)]
        fields: dict[str, Any] = {**clocked.fields, "identity": identity}
        fields |= {text: getattr(head, text) for text in TEXTS}
        fields |= {"wheel_scale": head.wheel_scale, "leading_end": head.leading_end or ""}
        if not needs_time:
            fields["provenance"] = [*head.provenance, *steps]
            return build_recording(**fields)
        sources, notes = position_sources(description, head, raw, clocked.positions, clocked.epoch)
        steps += [REPAIR_PREFIX + note for note in notes]
    fields["provenance"] = [*head.provenance, *steps]
    return UnlocatedRecording(data, columns, sources, fields)
