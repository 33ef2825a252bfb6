"""From signals with clocks to the arguments of `build_recording`: clocks are repaired and brought to one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trackprofile.contracts import Channel
from trackprofile.errors import DataError
from trackprofile.io.recording_columns import Signals
from trackprofile.preprocessing.clock import repair_clock
from trackprofile.preprocessing.faults import ClockFault
from trackprofile.preprocessing.motion import fill_speed
from trackprofile.preprocessing.resampling import Series, resample_to_one_clock

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ClockedSignals:
    """Signals on one clock.

    Parameters
    ----------
    fields : arguments of `build_recording` by name: channels, motion, faults of the clock
    positions : columns that tell the train's position, on their own clocks
    notes : sentences on what was repaired
    epoch : time of the clock at which the recording's time is 0 [s]
    """

    fields: Mapping[str, Any]
    positions: Mapping[str, Series]
    notes: tuple[str, ...]
    epoch: float = 0.0


def on_one_clock(signals: Signals, *, needs_time: bool) -> ClockedSignals:
    """Signals with repaired clocks, on one of them.

    Parameters
    ----------
    needs_time : whether positions are to be estimated, which needs the time of each sample

    Raises
    ------
    DataError : columns of one clock differ in length, a clock is missing, or one cannot be repaired.
    """
    if len(set(signals.clock_of.values())) == 1:
        return _common_clock(signals, needs_time=needs_time)
    return _several_clocks(signals)


def _common_clock(signals: Signals, *, needs_time: bool) -> ClockedSignals:
    (clock,) = set(signals.clock_of.values())
    _check_lengths(signals, None if clock is None else len(signals.clocks[clock]))
    motion, notes = dict(signals.motion), _missing_samples(signals.channels)
    channels, positions, faults = signals.channels, {}, None
    if clock is not None:
        repaired = repair_clock(signals.clocks[clock], motion.get("distance"), motion.get("speed"))
        kept, time = repaired.kept, repaired.time
        notes += repaired.notes
        motion = {name: values[kept] for name, values in motion.items()} | {"time": time}
        positions = {name: Series(time, values[kept]) for name, values in signals.positions.items()}
        channels = tuple(
            replace(one, values=one.values[kept], valid=_validity(one)[kept]) for one in channels
        )
        faults = ClockFault.JUMP * repaired.jumped + ClockFault.REPEATED * repaired.repeated
    elif needs_time:
        raise DataError(
            "Positions cannot be assigned to samples without a time; add the key 'time' to [recording]."
        )
    speed, base = motion.get("speed"), motion.get("time", motion.get("distance"))
    if speed is not None and base is not None and not np.all(np.isfinite(speed)):
        missing = ~np.isfinite(speed)
        motion["speed"] = fill_speed(speed, base)
        notes.append(f"the speed is missing in {_count(missing, 'row')}: filled")
        faults = (0 if faults is None else faults) + ClockFault.SPEED * missing
    fields = {"channels": channels, **motion, "clock_fault": faults}
    return ClockedSignals(fields, positions, tuple(notes))


def _several_clocks(signals: Signals) -> ClockedSignals:
    clockless = [name for name, clock in signals.clock_of.items() if clock is None]
    if clockless:
        raise DataError(
            f"{', '.join(map(repr, clockless))}: no clock, while other columns have one; add the key 'time' there, or "
            "remove the column from the TOML."
        )
    notes, repaired = _missing_samples(signals.channels), {}
    for clock, time in signals.clocks.items():
        repaired[clock] = repair_clock(time)
        notes += [f"{clock.column}: {note}" for note in repaired[clock].notes]
    epoch = min(float(one.time[0]) for one in repaired.values())

    def series(name: str, values: Array) -> Series:
        clock = signals.clock_of[name]
        assert clock is not None
        kept = repaired[clock].kept
        if len(values) != len(kept):
            raise DataError(
                f"{name!r} has {len(values)} values, its clock {clock.column!r} has {len(kept)}; name the clock of "
                "this column (key 'time')."
            )
        return Series(repaired[clock].time - epoch, values[kept])

    sensors = {
        one.name: series(one.name, np.where(_validity(one), one.values, np.nan))
        for one in signals.channels
    }
    motion = {name: _known(series(name, values)) for name, values in signals.motion.items()}
    positions = {name: series(name, values) for name, values in signals.positions.items()}
    base, values, motion = resample_to_one_clock(sensors, motion)
    channels = tuple(
        replace(one, values=values[one.name], valid=np.isfinite(values[one.name]))
        for one in signals.channels
    )
    notes.append(f"{len(repaired)} clocks were brought to one")
    fields = {"channels": channels, "time": base, **motion, "clock_fault": 0}
    return ClockedSignals(fields, positions, tuple(notes), epoch)


def _check_lengths(signals: Signals, expected: int | None) -> None:
    """Refuse columns of one clock that differ in length."""
    lengths = {one.name: len(one.values) for one in signals.channels}
    lengths |= {n: len(values) for n, values in {**signals.motion, **signals.positions}.items()}
    if expected is None:
        expected = next(iter(lengths.values()))
    for name, length in lengths.items():
        if length != expected:
            raise DataError(
                f"{name!r}: expected {expected} values, got {length}; copy the file again if it is cut short, or name "
                "the clock of this column (key 'time')."
            )


def _known(series: Series) -> Series:
    known = np.isfinite(series.values)
    return Series(series.time[known], series.values[known])


def _missing_samples(channels: tuple[Channel, ...]) -> list[str]:
    """A sentence on each channel that is not a number at a sample marked invalid."""
    notes = []
    for one in channels:
        missing = ~np.isfinite(one.values)
        if (missing & ~_validity(one)).any():
            verb = "is" if np.count_nonzero(missing) == 1 else "are"
            notes.append(f"{_count(missing, 'sample')} of {one.name!r} {verb} missing")
    return notes


def _validity(channel: Channel) -> NDArray[np.bool_]:
    return np.ones(len(channel.values), bool) if channel.valid is None else channel.valid


def _count(mask: NDArray[np.bool_], noun: str) -> str:
    count = np.count_nonzero(mask)
    return f"{count} {noun}{'' if count == 1 else 's'}"
