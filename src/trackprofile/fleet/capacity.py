"""Cores, memory, storage and data transfer that a network needs, from the cost of one recording."""

from __future__ import annotations

import math
from dataclasses import dataclass

from trackprofile.errors import DataError

YEAR = 365.0
"""days"""


@dataclass(frozen=True)
class Network:
    """Assumptions about a network; none of them is measured here.

    Parameters
    ----------
    length : of the lines [m]
    passes : over each metre of them, a day
    recording_length : of one recording [m]
    train_speed : while it records [m/s]
    hours : of a day in which recordings are sent and computed
    utilisation : share of the cores' time that is work
    copies : of what is kept
    raw_days : that recordings are kept

    Raises
    ------
    DataError : one of them cannot be.
    """

    length: float = 10_000e3
    passes: float = 50.0
    recording_length: float = 10e3
    train_speed: float = 33.0
    hours: float = 24.0
    utilisation: float = 0.6
    copies: float = 2.0
    raw_days: float = 30.0

    def __post_init__(self) -> None:
        above_zero = (
            self.length,
            self.passes,
            self.recording_length,
            self.train_speed,
            self.copies,
        )
        if not all(math.isfinite(one) and one > 0 for one in above_zero):
            raise DataError("A plan needs lines, passes, recordings, a speed and copies above 0.")
        if not 0 < self.hours <= 24:
            raise DataError(f"Hours of a day with work: expected up to 24, got {self.hours:g}.")
        if not 0 < self.utilisation <= 1:
            raise DataError(f"Utilisation: expected above 0 and up to 1, got {self.utilisation:g}.")
        if not (math.isfinite(self.raw_days) and self.raw_days >= 0):
            raise DataError(
                f"Days that recordings are kept: expected 0 or more, got {self.raw_days:g}."
            )


@dataclass(frozen=True)
class Cost:
    """Measured cost of one metre of one pass.

    Parameters
    ----------
    cpu : to read, infer, assess and store it [s/m]
    memory : that a worker had at most [B]
    recorded, recorded_as_csv : as the train sends it, in Parquet and in CSV [B/m]
    stored : profile, overview, assessment and entry [B/m]
    files : that a recording takes in the store
    """

    cpu: float
    memory: float
    recorded: float
    recorded_as_csv: float
    stored: float
    files: float


@dataclass(frozen=True)
class Need:
    """Requirements of the network.

    Parameters
    ----------
    metres : recorded a day
    recordings : a day
    core_seconds : a day
    cores : for the hours that there are, at that utilisation
    memory : of all workers [B]
    received : a day [B]
    received_rate : while it is received [bit/s]
    raw_kept : recordings, with copies [B]
    stored : a day, one copy [B]
    stored_year : a year's, with copies [B]
    files_year : of the store, a year's, one copy
    written_rate : to the store, while it is computed, one copy [bit/s]
    """

    metres: float
    recordings: float
    core_seconds: float
    cores: int
    memory: float
    received: float
    received_rate: float
    raw_kept: float
    stored: float
    stored_year: float
    files_year: float
    written_rate: float


def need(network: Network, cost: Cost) -> Need:
    """Requirements of a network at this cost per metre and pass.

    The cores are c l p / (h u): seconds per metre, metres of line, passes a day, seconds of a day in which there is
    work, and the share of them that is.

    Examples
    --------
    >>> cost = Cost(cpu=1e-3, memory=5e8, recorded=200.0, recorded_as_csv=600.0, stored=100.0, files=7)
    >>> found = need(Network(length=1e6, passes=10, hours=10, utilisation=0.5), cost)
    >>> found.cores, found.memory, found.received, round(found.received_rate)
    (1, 500000000.0, 2000000000.0, 444444)
    """
    metres = network.length * network.passes
    recordings = metres / network.recording_length
    seconds = 3600.0 * network.hours
    core_seconds = cost.cpu * metres
    cores = max(1, math.ceil(core_seconds / (seconds * network.utilisation) - 1e-9))
    received, stored = cost.recorded * metres, cost.stored * metres
    return Need(
        metres=metres,
        recordings=recordings,
        core_seconds=core_seconds,
        cores=cores,
        memory=cores * cost.memory,
        received=received,
        received_rate=8 * received / seconds,
        raw_kept=received * network.raw_days * network.copies,
        stored=stored,
        stored_year=stored * YEAR * network.copies,
        files_year=cost.files * recordings * YEAR,
        written_rate=8 * stored / seconds,
    )
