"""Kinds of damage that loggers do to recordings, each as what it does to the columns of a table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
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
class Sensor:
    """As a TOML describes it."""

    column: str
    quantity: str
    unit: str
    body: str
    position: float
    noise_density: float | None
    bandwidth: float | None = None
    time: str = ""


@dataclass(frozen=True)
class Table:
    """What a logger recorded: ``time_s``, ``distance_m``, ``speed_km_h`` and the sensors' columns.

    ``places`` is what a TOML says of where the train was, where that is not the distance and the speed.
    """

    columns: Columns
    sensors: tuple[Sensor, ...]
    time_unit: str = "s"
    places: str = ""

    @property
    def first(self) -> str:
        return self.sensors[0].column

    def with_(self, **changes: Array) -> Table:
        return Table(self.columns | changes, self.sensors, self.time_unit, self.places)

    def first_with(self, change: Callable[[Array], Array]) -> Table:
        """With the first sensor changed, and recorded in the same steps as before."""
        before = self.columns[self.first]
        step, changed = recorded_step(before), change(before.copy())
        return self.with_(**{self.first: step * np.round(changed / step) if step else changed})

    def rows(self, kept: Array) -> Table:
        columns = {name: values[kept] for name, values in self.columns.items()}
        return Table(columns, self.sensors, self.time_unit, self.places)


Writer = Callable[[Table, Path], str]


@dataclass(frozen=True)
class Damage:
    """One kind: what it does, by what it is known, and which samples are harmed (as shares of the whole; None: none).

    ``kinds`` one of which has to be found; ``said`` a text in a note; ``refused`` the sentence with which it is;
    ``placed`` where the distance comes of other things: then the profile is judged where the train really was, and
    the distance by what it says of itself.
    """

    name: str
    change: Callable[[Table], Table] = field(default=lambda table: table)
    kinds: frozenset[FaultKind] = frozenset()
    said: str = ""
    harmed: tuple[float, float] | None = None
    writer: Writer | None = None
    refused: str = ""
    everywhere: bool = False
    placed: bool = False


def write(table: Table, folder: Path, writer: Writer | None) -> Path:
    """The file and the TOML that explains it."""
    data = (writer or as_csv)(table, folder)
    lines = [
        "[recording]",
        f'data = "{data}"',
        f'time = {{ column = "time_s", unit = "{table.time_unit}" }}',
    ]
    if table.places:
        lines.append(table.places)
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


def as_csv(table: Table, folder: Path) -> str:
    write_columns(folder / "run.csv", table.columns)
    return "run.csv"


def as_(suffix: str) -> Writer:
    def writer(table: Table, folder: Path) -> str:
        columns = dict(table.columns)
        if suffix in {".mf4", ".tdms"}:
            columns = {("time" if name == "time_s" else name): one for name, one in columns.items()}
        write_columns(folder / f"run{suffix}", columns)
        return f"run{suffix}"

    return writer


def text_of(table: Table, separator: str, decimal: str, above: str, units: str) -> str:
    names = list(table.columns)
    rows = (
        separator.join(repr(float(value)).replace(".", decimal) for value in row)
        for row in zip(*table.columns.values(), strict=True)
    )
    unit_row = [separator.join(units for _ in names)] if units else []
    return "\n".join([above + separator.join(names), *unit_row, *rows]) + "\n"


def german(table: Table, folder: Path) -> str:
    text = text_of(table, ";", ",", "Messgerät 7;Fw 2\nOrt;Böden\n\n", "")
    (folder / "run.txt").write_text(text, encoding="cp1252")
    return "run.txt"


def tabs_in_utf_16(table: Table, folder: Path) -> str:
    (folder / "run.txt").write_text(text_of(table, "\t", ".", "", "[x]"), encoding="utf-16")
    return "run.txt"


def blanks(table: Table, folder: Path) -> str:
    (folder / "run.dat").write_text(text_of(table, "   ", ".", "", ""))
    return "run.dat"


def stamped(table: Table, folder: Path) -> str:
    begin = datetime(2024, 2, 28, 23, 59, 50)  # over midnight, into a leap day
    lines = [";".join(table.columns)]
    for row in zip(*table.columns.values(), strict=True):
        at = begin + timedelta(seconds=float(row[0]))
        lines.append(";".join([f"{at:%d.%m.%Y %H:%M:%S},{at.microsecond:06d}",
                               *(repr(float(v)).replace(".", ",") for v in row[1:])]))  # fmt: skip
    (folder / "run.csv").write_text("\n".join(lines) + "\n")
    return "run.csv"


def two_clocks(table: Table, folder: Path) -> str:
    """All but the first sensor at half the rate, with a clock of their own."""
    with h5py.File(folder / "run.h5", "w") as file:
        for name, values in table.columns.items():
            slow = name in {one.column for one in table.sensors[1:]} or name == "slow_s"
            file[name] = values[::2] if slow else values
    return "run.h5"


def at(table: Table, begin: float, end: float) -> slice:
    count = len(next(iter(table.columns.values())))
    return slice(int(begin * count), int(end * count))


def on_first(
    change: Callable[[Array, slice], None], begin: float, end: float
) -> Callable[[Table], Table]:
    """Damage to a stretch of the first sensor."""

    def changed(table: Table) -> Table:
        def inside(values: Array) -> Array:
            change(values, at(table, begin, end))
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


def burst(values: Array, part: slice) -> None:
    generator = np.random.default_rng(2)
    for start in generator.choice(np.arange(part.start, part.stop - 6), 4, replace=False):
        values[start : start + 6] += 20 * rms(values) * generator.standard_normal(6)


def clipped(values: Array, part: slice) -> None:
    end = 0.8 * np.max(np.abs(values))
    values[:] = np.clip(values, -end, end)


def held(values: Array, part: slice) -> None:
    values[part] = values[part.start]


def louder(values: Array, part: slice) -> None:
    generator = np.random.default_rng(3)
    values[part] += rms(values) * generator.standard_normal(part.stop - part.start)


def coarse(values: Array, part: slice) -> None:
    step = 0.5 * rms(values)
    values[part] = step * np.round(values[part] / step)


def jumped(values: Array, part: slice) -> None:
    values[part.start :] += 1.0 * rms(values)


def copied(values: Array, part: slice) -> None:
    length = part.stop - part.start
    values[part] = values[part.start - length : part.start]


def drifting(table: Table) -> Table:
    return table.first_with(
        lambda values: values + rms(values) * np.sin(np.linspace(0, 2 * np.pi, len(values)))
    )


def lost(begin: float, end: float) -> Callable[[Table], Table]:
    def changed(table: Table) -> Table:
        part = at(table, begin, end)
        kept = np.ones(len(table.columns["time_s"]), bool)
        kept[part] = False
        return table.rows(kept)

    return changed


def some_lost(table: Table) -> Table:
    generator = np.random.default_rng(4)
    return table.rows(generator.random(len(table.columns["time_s"])) > 0.01)


def rows_twice(table: Table) -> Table:
    generator = np.random.default_rng(5)
    count = len(table.columns["time_s"])
    twice = generator.random(count) < 0.01
    return table.rows(np.repeat(np.arange(count), 1 + twice))


def clock_moved(by: float) -> Callable[[Table], Table]:
    def changed(table: Table) -> Table:
        time = table.columns["time_s"].copy()
        time[len(time) // 2 :] += by
        return table.with_(time_s=time)

    return changed


def coarse_clock(table: Table) -> Table:
    return table.with_(time_s=np.floor(table.columns["time_s"] / 0.1) * 0.1)


def stamps_missing(table: Table) -> Table:
    time = table.columns["time_s"].copy()
    time[np.random.default_rng(6).random(len(time)) < 0.01] = np.nan
    return table.with_(time_s=time)


def speed_missing(table: Table) -> Table:
    speed = table.columns["speed_km_h"].copy()
    speed[at(table, 0.3, 0.33)] = np.nan
    speed[np.random.default_rng(7).random(len(speed)) < 0.02] = np.nan
    return table.with_(speed_km_h=speed)


def whole_speed(table: Table) -> Table:
    return table.with_(speed_km_h=np.round(table.columns["speed_km_h"]))


def cells_missing(table: Table) -> Table:
    def emptied(values: Array) -> Array:
        values[at(table, 0.45, 0.46)] = np.nan
        return values

    return table.first_with(emptied)


def dead(table: Table) -> Table:
    last = table.sensors[-1].column
    return table.with_(**{last: np.zeros_like(table.columns[last])})


def exchanged(table: Table) -> Table:
    a, b = (one.column for one in table.sensors[:2])
    return table.with_(**{a: table.columns[b], b: table.columns[a]})


def turned(table: Table) -> Table:
    return table.first_with(np.negative)


def upside_down(table: Table) -> Table:
    return table.first_with(lambda values: -(values + GRAVITY))


def tilted(table: Table) -> Table:
    return table.first_with(lambda values: np.cos(np.radians(35.0)) * (values + GRAVITY))


def far_off(table: Table) -> Table:
    return table.first_with(lambda values: values + 2.0)


def slow_gyro(table: Table) -> Table:
    columns = table.columns | {"slow_s": table.columns["time_s"]}
    first, *others = table.sensors
    with_clock = tuple(Sensor(**(vars(one) | {"time": "slow_s"})) for one in others)
    return Table(columns, (first, *with_clock), table.time_unit)


def dated(table: Table) -> Table:
    return Table(table.columns, table.sensors, "D.M.Y")


PULSE = np.pi * 0.92 / 80

PLACES = """[recording.gnss]
latitude = { column = "lat", unit = "°" }
longitude = { column = "lon", unit = "°" }

[recording.odometer]
column = "pulses"
unit = "pulses"
per_revolution = 80
wheel_diameter = 0.92
"""


def placed(table: Table, slip: float = 0.0) -> Table:
    """Instead of a distance and a speed satellite positions, a tenth of them far off, none for a while, and a worn
    wheel's pulses; ``slip`` m too many of them in a second and a half."""
    generator = np.random.default_rng(8)
    time, distance = table.columns["time_s"], table.columns["distance_m"]
    slipped = slip * np.clip((time - np.mean(time)) / 1.5, 0.0, 1.0)
    pulses = np.floor((distance / 0.99 + slipped) / PULSE)
    lat, lon = np.full(len(time), np.nan), np.full(len(time), np.nan)
    rows = np.searchsorted(time, np.arange(time[0], time[-1], 1.0))
    rows = rows[(rows < 0.5 * len(time)) | (rows > 0.65 * len(time))]
    off = generator.standard_normal((2, len(rows)))
    off[:, generator.random(len(rows)) < 0.1] += 50.0
    metre = 1.0 / 111.2e3
    lat[rows] = 36.0 + metre * (distance[rows] + off[0])
    lon[rows] = 137.0 + metre / np.cos(np.radians(36.0)) * off[1]
    columns = {
        name: one for name, one in table.columns.items() if name not in {"distance_m", "speed_km_h"}
    }
    return Table(
        columns | {"pulses": pulses, "lat": lat, "lon": lon}, table.sensors, table.time_unit, PLACES
    )


def slipping(table: Table) -> Table:
    return placed(table, 4.0)


K = FaultKind
DAMAGES: tuple[Damage, ...] = (
    Damage("CSV with semicolons, decimal commas, words above, in Windows' letters", writer=german),
    Damage("CSV with tabs and a row of units, in UTF-16", writer=tabs_in_utf_16),
    Damage("CSV with blanks", writer=blanks),
    Damage("times as dates, over midnight and a leap day", dated, writer=stamped),
    Damage("Parquet", writer=as_(".parquet")),
    Damage("HDF5", writer=as_(".h5")),
    Damage("MATLAB", writer=as_(".mat")),
    Damage("MDF", writer=as_(".mf4")),
    Damage("TDMS", writer=as_(".tdms")),
    Damage(
        "two rates and clocks",
        slow_gyro,
        said="clocks were brought to one",
        writer=two_clocks,
        everywhere=True,
    ),
    Damage("a gap", lost(0.4, 0.41), frozenset({K.GAP}), harmed=(0.4, 0.41)),
    Damage("one row in a hundred lost", some_lost, frozenset({K.GAP})),
    Damage(
        "one row in a hundred twice", rows_twice, frozenset({K.REPEATED}), said="twice: left out"
    ),
    Damage(
        "a buffer sent twice",
        on_first(copied, 0.5, 0.51),
        frozenset({K.REPEATED}),
        harmed=(0.5, 0.51),
    ),
    Damage(
        "a clock set back by 3 s",
        clock_moved(-3.0),
        frozenset({K.CLOCK}),
        said="the clock jumps once",
    ),
    Damage(
        "a clock that leaps ahead by 5 s",
        clock_moved(5.0),
        frozenset({K.CLOCK}),
        said="the clock jumps once",
    ),
    Damage("a clock of tenths of a second", coarse_clock, said="coarser than the sampling"),
    Damage("times missing", stamps_missing, said="times are missing"),
    Damage("speed in whole km/h", whole_speed),
    Damage("speed missing", speed_missing, frozenset({K.SPEED}), said="the speed is missing"),
    Damage(
        "samples missing",
        cells_missing,
        frozenset({K.MISSING}),
        said="are missing",
        harmed=(0.45, 0.46),
    ),
    Damage(
        "spikes", on_first(spiked, 0.3, 0.7), frozenset({K.SPIKE, K.OUTLIER}), harmed=(0.3, 0.7)
    ),
    Damage("bursts", on_first(burst, 0.3, 0.4), frozenset({K.OUTLIER}), harmed=(0.3, 0.4)),
    Damage(
        "end of a range", on_first(clipped, 0.0, 1.0), frozenset({K.SATURATED}), everywhere=True
    ),
    Damage(
        "a sensor that sticks", on_first(held, 0.6, 0.61), frozenset({K.STUCK}), harmed=(0.6, 0.61)
    ),
    Damage(
        "a stretch that is loud",
        on_first(louder, 0.4, 0.5),
        frozenset({K.LOUD, K.OUTLIER}),
        harmed=(0.4, 0.5),
    ),
    Damage(
        "a stretch in coarse steps",
        on_first(coarse, 0.4, 0.5),
        frozenset({K.COARSE, K.LOUD}),
        harmed=(0.4, 0.5),
    ),
    Damage(
        "an offset that jumps",
        on_first(jumped, 0.5, 0.5),
        frozenset({K.JUMP, K.DRIFT}),
        harmed=(0.49, 0.51),
    ),
    Damage("an offset that drifts", drifting, frozenset({K.DRIFT}), everywhere=True),
    Damage("an offset of 2 m/s²", far_off, said="has an offset"),
    Damage("gravity, upside down", upside_down, said="turned upside down"),
    Damage("35° off the vertical", tilted, said="corrected for 35°", everywhere=True),
    Damage(
        "a dead channel",
        dead,
        frozenset({K.STUCK}),
        said="(stuck): it is not used",
        everywhere=True,
    ),
    Damage("two channels exchanged", exchanged, frozenset({K.EXCHANGED}), said="are exchanged"),
    Damage(
        "satellite positions far off and missing, and pulses",
        placed,
        said="places come from",
        placed=True,
    ),
    Damage("a wheel that slips", slipping, frozenset({K.SLIP}), placed=True),
    Damage("one sign turned", turned, refused="one of them is wrong"),
)
