"""Faults of loggers, injected into the columns of a recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from pathlib import Path

import h5py
import numpy as np

from trackprofile.arrays import recorded_step
from trackprofile.io.table import write_columns
from trackprofile.preprocessing.faults import FaultKind

Array = np.ndarray
Columns = dict[str, Array]

GRAVITY = 9.80665


@dataclass(frozen=True)
class SensorColumn:
    """Column of a sensor as the TOML describes it."""

    column: str
    quantity: str
    unit: str
    body: str
    position: float
    noise_density: float | None
    bandwidth: float | None = None
    time: str = ""


@dataclass(frozen=True)
class LoggerTable:
    """LoggerTable of a logger: ``time_s``, ``distance_m``, ``speed_km_h`` and the sensors' columns.

    ``position_sources`` is the part of the TOML that describes them; "" if distance and speed are recorded.
    """

    columns: Columns
    sensors: tuple[SensorColumn, ...]
    time_unit: str = "s"
    position_sources: str = ""

    @property
    def first(self) -> str:
        return self.sensors[0].column

    def with_(self, **changes: Array) -> LoggerTable:
        return LoggerTable(
            self.columns | changes, self.sensors, self.time_unit, self.position_sources
        )

    def first_with(self, change: Callable[[Array], Array]) -> LoggerTable:
        """The table with the first sensor's signal changed, with the same quantisation as before."""
        before = self.columns[self.first]
        step, changed = recorded_step(before), change(before.copy())
        return self.with_(**{self.first: step * np.round(changed / step) if step else changed})

    def rows(self, kept: Array) -> LoggerTable:
        columns = {name: values[kept] for name, values in self.columns.items()}
        return LoggerTable(columns, self.sensors, self.time_unit, self.position_sources)


Writer = Callable[[LoggerTable, Path], str]


@dataclass(frozen=True)
class InjectedFault:
    """A fault and its expected treatment.

    Parameters
    ----------
    change : injects it
    kinds : kinds of faults, one of which has to be reported
    note : text that a note has to contain
    stretch : start and end of the faulty samples as shares of the recording; None: no single stretch
    writer : writes the table in another format than CSV
    refused : text of the error with which the recording has to be refused
    everywhere : whether the error of the complete profile may increase
    estimated_distance : whether the distance is estimated from position sources: then the profile is compared at the
        true positions, and the distance with its stated standard deviation
    """

    name: str
    change: Callable[[LoggerTable], LoggerTable] = field(default=lambda table: table)
    kinds: frozenset[FaultKind] = frozenset()
    note: str = ""
    stretch: tuple[float, float] | None = None
    writer: Writer | None = None
    refused: str = ""
    everywhere: bool = False
    estimated_distance: bool = False


def write(table: LoggerTable, folder: Path, writer: Writer | None) -> Path:
    """Write the table and the TOML that describes it."""
    data = (writer or as_csv)(table, folder)
    lines = [
        "[recording]",
        f'data = "{data}"',
        f'time = {{ column = "time_s", unit = "{table.time_unit}" }}',
    ]
    if table.position_sources:
        lines.append(table.position_sources)
    else:
        if "distance_m" in table.columns:
            lines.append('distance = { column = "distance_m", unit = "m" }')
        lines.append('speed = { column = "speed_km_h", unit = "km/h" }')
    for one in table.sensors:
        lines += ["", "[[sensor]]", f'column = "{one.column}"', f'unit = "{one.unit}"',
                  f'quantity = "{one.quantity}"', f'body = "{one.body}"', f"position = {one.position}"]  # fmt: skip
        lines += [f"noise_density = {one.noise_density}"] if one.noise_density else []
        lines += [f"bandwidth = {one.bandwidth}"] if one.bandwidth else []
        lines += [f'time = {{ column = "{one.time}", unit = "s" }}'] if one.time else []
    (folder / "run.toml").write_text("\n".join(lines), encoding="utf-8")
    return folder / "run.toml"


def as_csv(table: LoggerTable, folder: Path) -> str:
    write_columns(folder / "run.csv", table.columns)
    return "run.csv"


def in_format(suffix: str) -> Writer:
    def writer(table: LoggerTable, folder: Path) -> str:
        columns = dict(table.columns)
        if suffix in {".mf4", ".tdms"}:
            columns = {("time" if name == "time_s" else name): one for name, one in columns.items()}
        write_columns(folder / f"run{suffix}", columns)
        return f"run{suffix}"

    return writer


def csv_text(table: LoggerTable, separator: str, decimal: str, above: str, units: str) -> str:
    names = list(table.columns)
    rows = (
        separator.join(repr(float(value)).replace(".", decimal) for value in row)
        for row in zip(*table.columns.values(), strict=True)
    )
    unit_row = [separator.join(units for _ in names)] if units else []
    return "\n".join([above + separator.join(names), *unit_row, *rows]) + "\n"


def german_csv(table: LoggerTable, folder: Path) -> str:
    text = csv_text(table, ";", ",", "Messgerät 7;Fw 2\nOrt;Böden\n\n", "")
    (folder / "run.txt").write_text(text, encoding="cp1252")
    return "run.txt"


def tabs_in_utf_16(table: LoggerTable, folder: Path) -> str:
    (folder / "run.txt").write_text(csv_text(table, "\t", ".", "", "[x]"), encoding="utf-16")
    return "run.txt"


def spaces(table: LoggerTable, folder: Path) -> str:
    (folder / "run.dat").write_text(csv_text(table, "   ", ".", "", ""))
    return "run.dat"


def dates(table: LoggerTable, folder: Path) -> str:
    start = datetime(2024, 2, 28, 23, 59, 50)  # over midnight, into a leap day
    lines = [";".join(table.columns)]
    for row in zip(*table.columns.values(), strict=True):
        at = start + timedelta(seconds=float(row[0]))
        lines.append(";".join([f"{at:%d.%m.%Y %H:%M:%S},{at.microsecond:06d}",
                               *(repr(float(v)).replace(".", ",") for v in row[1:])]))  # fmt: skip
    (folder / "run.csv").write_text("\n".join(lines) + "\n")
    return "run.csv"


def two_clocks(table: LoggerTable, folder: Path) -> str:
    """All sensors but the first at half the sampling rate, with a separate clock."""
    with h5py.File(folder / "run.h5", "w") as file:
        for name, values in table.columns.items():
            slow = name in {one.column for one in table.sensors[1:]} or name == "slow_s"
            file[name] = values[::2] if slow else values
    return "run.h5"


def at(table: LoggerTable, start: float, end: float) -> slice:
    count = len(next(iter(table.columns.values())))
    return slice(int(start * count), int(end * count))


def in_first_sensor(
    change: Callable[[Array, slice], None], start: float, end: float
) -> Callable[[LoggerTable], LoggerTable]:
    """Fault of the first sensor in a stretch."""

    def changed(table: LoggerTable) -> LoggerTable:
        def inside(values: Array) -> Array:
            change(values, at(table, start, end))
            return values

        return table.first_with(inside)

    return changed


def rms(values: Array) -> float:
    return float(np.std(values))


def spiked(values: Array, part: slice) -> None:
    generator = np.random.default_rng(1)
    where = part.start + generator.choice(
        part.stop - part.start, (part.stop - part.start) // 50, replace=False
    )
    values[where] += 30 * rms(values) * generator.choice([-1, 1], len(where))


def bursts(values: Array, part: slice) -> None:
    generator = np.random.default_rng(2)
    for start in generator.choice(np.arange(part.start, part.stop - 6), 4, replace=False):
        values[start : start + 6] += 20 * rms(values) * generator.standard_normal(6)


def clipped(values: Array, part: slice) -> None:
    end = 0.8 * np.max(np.abs(values))
    values[:] = np.clip(values, -end, end)


def stuck_at_one_value(values: Array, part: slice) -> None:
    values[part] = values[part.start]


def noisy(values: Array, part: slice) -> None:
    generator = np.random.default_rng(3)
    values[part] += rms(values) * generator.standard_normal(part.stop - part.start)


def coarsely_quantised(values: Array, part: slice) -> None:
    step = 0.5 * rms(values)
    values[part] = step * np.round(values[part] / step)


def with_jump(values: Array, part: slice) -> None:
    values[part.start :] += 1.0 * rms(values)


def repeated_buffer(values: Array, part: slice) -> None:
    length = part.stop - part.start
    values[part] = values[part.start - length : part.start]


def with_drift(table: LoggerTable) -> LoggerTable:
    return table.first_with(
        lambda values: values + rms(values) * np.sin(np.linspace(0, 2 * np.pi, len(values)))
    )


def with_gap(start: float, end: float) -> Callable[[LoggerTable], LoggerTable]:
    def changed(table: LoggerTable) -> LoggerTable:
        part = at(table, start, end)
        kept = np.ones(len(table.columns["time_s"]), bool)
        kept[part] = False
        return table.rows(kept)

    return changed


def random_rows_dropped(table: LoggerTable) -> LoggerTable:
    generator = np.random.default_rng(4)
    return table.rows(generator.random(len(table.columns["time_s"])) > 0.01)


def random_rows_repeated(table: LoggerTable) -> LoggerTable:
    generator = np.random.default_rng(5)
    count = len(table.columns["time_s"])
    twice = generator.random(count) < 0.01
    return table.rows(np.repeat(np.arange(count), 1 + twice))


def clock_shifted(by: float) -> Callable[[LoggerTable], LoggerTable]:
    def changed(table: LoggerTable) -> LoggerTable:
        time = table.columns["time_s"].copy()
        time[len(time) // 2 :] += by
        return table.with_(time_s=time)

    return changed


def coarse_clock(table: LoggerTable) -> LoggerTable:
    return table.with_(time_s=np.floor(table.columns["time_s"] / 0.1) * 0.1)


def time_stamps_missing(table: LoggerTable) -> LoggerTable:
    time = table.columns["time_s"].copy()
    time[np.random.default_rng(6).random(len(time)) < 0.01] = np.nan
    return table.with_(time_s=time)


def speed_missing(table: LoggerTable) -> LoggerTable:
    speed = table.columns["speed_km_h"].copy()
    speed[at(table, 0.3, 0.33)] = np.nan
    speed[np.random.default_rng(7).random(len(speed)) < 0.02] = np.nan
    return table.with_(speed_km_h=speed)


def speed_in_whole_km_h(table: LoggerTable) -> LoggerTable:
    return table.with_(speed_km_h=np.round(table.columns["speed_km_h"]))


def samples_missing(table: LoggerTable) -> LoggerTable:
    def emptied(values: Array) -> Array:
        values[at(table, 0.45, 0.46)] = np.nan
        return values

    return table.first_with(emptied)


def dead_channel(table: LoggerTable) -> LoggerTable:
    last = table.sensors[-1].column
    return table.with_(**{last: np.zeros_like(table.columns[last])})


def exchanged(table: LoggerTable) -> LoggerTable:
    a, b = (one.column for one in table.sensors[:2])
    return table.with_(**{a: table.columns[b], b: table.columns[a]})


def sign_inverted(table: LoggerTable) -> LoggerTable:
    return table.first_with(np.negative)


def upside_down(table: LoggerTable) -> LoggerTable:
    return table.first_with(lambda values: -(values + GRAVITY))


def tilted(table: LoggerTable) -> LoggerTable:
    return table.first_with(lambda values: np.cos(np.radians(35.0)) * (values + GRAVITY))


def with_offset(table: LoggerTable) -> LoggerTable:
    return table.first_with(lambda values: values + 2.0)


def slow_gyroscope(table: LoggerTable) -> LoggerTable:
    columns = table.columns | {"slow_s": table.columns["time_s"]}
    first, *others = table.sensors
    with_clock = tuple(replace(one, time="slow_s") for one in others)
    return LoggerTable(columns, (first, *with_clock), table.time_unit)


def with_dates(table: LoggerTable) -> LoggerTable:
    return LoggerTable(table.columns, table.sensors, "D.M.Y")


PULSE = np.pi * 0.92 / 80

POSITION_SOURCES = """[recording.gnss]
latitude = { column = "lat", unit = "°" }
longitude = { column = "lon", unit = "°" }

[recording.odometer]
column = "pulses"
unit = "pulses"
per_revolution = 80
wheel_diameter = 0.92
"""


def from_position_sources(table: LoggerTable, slip: float = 0.0) -> LoggerTable:
    """Distance and speed replaced by GNSS fixes, with a gap and 10 % outliers, and pulses of a worn wheel, which slips
    by ``slip`` m within 1.5 s."""
    generator = np.random.default_rng(8)
    time, distance = table.columns["time_s"], table.columns["distance_m"]
    slipped = slip * np.clip((time - np.mean(time)) / 1.5, 0.0, 1.0)
    pulses = np.floor((distance / 0.99 + slipped) / PULSE)
    lat, lon = np.full(len(time), np.nan), np.full(len(time), np.nan)
    rows = np.searchsorted(time, np.arange(time[0], time[-1], 1.0))
    rows = rows[(rows < 0.5 * len(time)) | (rows > 0.65 * len(time))]
    error = generator.standard_normal((2, len(rows)))
    error[:, generator.random(len(rows)) < 0.1] += 50.0
    metre = 1.0 / 111.2e3
    lat[rows] = 36.0 + metre * (distance[rows] + error[0])
    lon[rows] = 137.0 + metre / np.cos(np.radians(36.0)) * error[1]
    columns = {
        name: one for name, one in table.columns.items() if name not in {"distance_m", "speed_km_h"}
    }
    return LoggerTable(
        columns | {"pulses": pulses, "lat": lat, "lon": lon},
        table.sensors,
        table.time_unit,
        POSITION_SOURCES,
    )


def with_slip(table: LoggerTable) -> LoggerTable:
    return from_position_sources(table, 4.0)


K = FaultKind
FAULTS: tuple[InjectedFault, ...] = (
    InjectedFault(
        "CSV with semicolons, decimal commas, text above the header, Windows code page",
        writer=german_csv,
    ),
    InjectedFault("CSV with tabs and a row of units, in UTF-16", writer=tabs_in_utf_16),
    InjectedFault("CSV with spaces", writer=spaces),
    InjectedFault("times as dates, over midnight and a leap day", with_dates, writer=dates),
    InjectedFault("Parquet", writer=in_format(".parquet")),
    InjectedFault("HDF5", writer=in_format(".h5")),
    InjectedFault("MATLAB", writer=in_format(".mat")),
    InjectedFault("MDF", writer=in_format(".mf4")),
    InjectedFault("TDMS", writer=in_format(".tdms")),
    InjectedFault(
        "two rates and clocks",
        slow_gyroscope,
        note="clocks were brought to one",
        writer=two_clocks,
        everywhere=True,
    ),
    InjectedFault("a gap", with_gap(0.4, 0.41), frozenset({K.GAP}), stretch=(0.4, 0.41)),
    InjectedFault("one row in a hundred lost", random_rows_dropped, frozenset({K.GAP})),
    InjectedFault(
        "one row in a hundred repeated",
        random_rows_repeated,
        frozenset({K.REPEATED}),
        note="the time stamp before them: dropped",
    ),
    InjectedFault(
        "a buffer repeated",
        in_first_sensor(repeated_buffer, 0.5, 0.51),
        frozenset({K.REPEATED}),
        stretch=(0.5, 0.51),
    ),
    InjectedFault(
        "clock set back by 3 s",
        clock_shifted(-3.0),
        frozenset({K.CLOCK}),
        note="the clock jumps once",
    ),
    InjectedFault(
        "clock advanced by 5 s",
        clock_shifted(5.0),
        frozenset({K.CLOCK}),
        note="the clock jumps once",
    ),
    InjectedFault(
        "clock with a resolution of 0.1 s", coarse_clock, note="coarser than the sampling"
    ),
    InjectedFault("times missing", time_stamps_missing, note="time stamps are missing"),
    InjectedFault("speed in whole km/h", speed_in_whole_km_h),
    InjectedFault(
        "speed missing", speed_missing, frozenset({K.SPEED}), note="the speed is missing"
    ),
    InjectedFault(
        "samples missing",
        samples_missing,
        frozenset({K.MISSING}),
        note="are missing",
        stretch=(0.45, 0.46),
    ),
    InjectedFault(
        "spikes",
        in_first_sensor(spiked, 0.3, 0.7),
        frozenset({K.SPIKE, K.OUTLIER}),
        stretch=(0.3, 0.7),
    ),
    InjectedFault(
        "bursts", in_first_sensor(bursts, 0.3, 0.4), frozenset({K.OUTLIER}), stretch=(0.3, 0.4)
    ),
    InjectedFault(
        "end of the range",
        in_first_sensor(clipped, 0.0, 1.0),
        frozenset({K.SATURATED}),
        everywhere=True,
    ),
    InjectedFault(
        "a stuck sensor",
        in_first_sensor(stuck_at_one_value, 0.6, 0.61),
        frozenset({K.STUCK}),
        stretch=(0.6, 0.61),
    ),
    InjectedFault(
        "a noisy stretch",
        in_first_sensor(noisy, 0.4, 0.5),
        frozenset({K.NOISY, K.OUTLIER}),
        stretch=(0.4, 0.5),
    ),
    InjectedFault(
        "a stretch with coarse resolution",
        in_first_sensor(coarsely_quantised, 0.4, 0.5),
        frozenset({K.COARSE, K.NOISY}),
        stretch=(0.4, 0.5),
    ),
    InjectedFault(
        "offset jump",
        in_first_sensor(with_jump, 0.5, 0.5),
        frozenset({K.JUMP, K.DRIFT}),
        stretch=(0.49, 0.51),
    ),
    InjectedFault("offset drift", with_drift, frozenset({K.DRIFT}), everywhere=True),
    InjectedFault("offset of 2 m/s²", with_offset, note="has an offset"),
    InjectedFault(
        "gravity included, sensor upside down", upside_down, note="inverted, gravity subtracted"
    ),
    InjectedFault("tilted by 35°", tilted, note="corrected for a tilt of 35°", everywhere=True),
    InjectedFault(
        "dead channel",
        dead_channel,
        frozenset({K.STUCK}),
        note="none of its samples is usable (stuck)",
        everywhere=True,
    ),
    InjectedFault(
        "two channels exchanged", exchanged, frozenset({K.EXCHANGED}), note="are exchanged"
    ),
    InjectedFault(
        "GNSS fixes with outliers and gaps, and pulses",
        from_position_sources,
        note="sources are",
        estimated_distance=True,
    ),
    InjectedFault("wheel slip", with_slip, frozenset({K.SLIP}), estimated_distance=True),
    InjectedFault("one sign reversed", sign_inverted, refused="one of them is wrong"),
)
