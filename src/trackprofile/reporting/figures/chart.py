"""What is drawn of a profile, as data, before any plotting library sees it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from trackprofile.arrays import runs
from trackprofile.bands import D1, D2, Band, band_pass_pieces, resample
from trackprofile.contracts import (
    Channel,
    Rail,
    available_rails,
    channels,
    known_elevation,
    select_rail,
)
from trackprofile.errors import DataError
from trackprofile.reporting import palette

Array = NDArray[np.float64]

MOST_POINTS = 4000
"""A trace with more is drawn by its extremes: about so many points are left of it."""

_TWO_SIDED_95 = 1.96
_MILLI = 1e3
_SHOWN_IN = {
    "vertical acceleration": ("m/s²", 1.0),
    "pitch rate": ("mrad/s", _MILLI),
    "roll rate": ("mrad/s", _MILLI),
}
ELEVATION, INTERVAL, GAP = "elevation", "95 % interval", "no data"
MEASURED, REPRODUCED, RESIDUAL = "measured", "reproduced", "residual"
SIMULATED = "simulated"
COLOURS = {
    ELEVATION: palette.LEVEL,
    INTERVAL: palette.INTERVAL,
    MEASURED: palette.GREY,
    REPRODUCED: palette.VERMILION,
    RESIDUAL: palette.GREEN,
    SIMULATED: palette.DARK_GREY,
    GAP: palette.MISSING,
}
WIDTHS = {ELEVATION: 1.2, MEASURED: 2.2, REPRODUCED: 0.8, RESIDUAL: 0.9}
OTHER_WIDTH = 0.9
INTERVAL_OPACITY, GAP_OPACITY = 0.4, 0.35


@dataclass(frozen=True)
class ChartLine:
    """A trace: NaN breaks it. x in m, y in the panel's unit; ``order`` picks a colour for a name that has none."""

    name: str
    x: Array
    y: Array
    decimated: bool = False
    order: int = 0

    @property
    def colour(self) -> str:
        """As both drawings show it."""
        return COLOURS.get(self.name, palette.LINES[self.order % len(palette.LINES)])

    @property
    def width(self) -> float:
        """As both drawings show it."""
        return WIDTHS.get(self.name, OTHER_WIDTH)


@dataclass(frozen=True)
class Interval:
    """An area between two traces. x in m, low and high in the panel's unit."""

    x: Array
    low: Array
    high: Array

    def outline(self) -> tuple[Array, Array]:
        """Closed polygons, one for each stretch between gaps, with NaN between them."""
        xs, ys = [np.empty(0)], [np.empty(0)]
        for run in runs(np.isfinite(self.low)):
            xs += [self.x[run], self.x[run][::-1], [np.nan]]
            ys += [self.low[run], self.high[run][::-1], [np.nan]]
        return np.concatenate(xs), np.concatenate(ys)


@dataclass(frozen=True)
class ChartPanel:
    """One strip of the chart: what is drawn, in which unit, how high relative to the others."""

    name: str
    about: str
    unit: str
    lines: tuple[ChartLine, ...]
    interval: Interval | None = None
    height: float = 1.0


@dataclass(frozen=True)
class Chart:
    """Panels over one distance axis; its ends, and the gaps' ends, in m."""

    title: str
    note: str
    ends: tuple[float, float]
    panels: tuple[ChartPanel, ...]
    gaps: tuple[tuple[float, float], ...]


def profile_chart(
    profile: xr.Dataset,
    recording: xr.Dataset | None,
    sample_distance: ArrayLike | None,
    reproduced: Mapping[str, ArrayLike],
) -> Chart:
    """Put a profile and its recording into panels; parameters as of `plot.interactive_profile_figure`."""
    track = _track(profile)
    panels = [_elevation_panel(track)]
    panels += [panel for band in (D1, D2) if (panel := _band_panel(track, band))]
    if recording is not None:
        where = _sample_distance(recording, sample_distance)
        known = channels(recording)
        _check_reproduced(reproduced, known, where.size)
        for channel in known:
            panels += channel_panels(channel, where, reproduced.get(channel.name))
    line = "" if recording is None else str(recording.attrs.get("line", ""))
    first, last = float(track.distance[0]), float(track.distance[-1])
    title = f"Track profile{', ' + line if line else ''}, {first:.0f} to {last:.0f} m"
    gaps = _gaps(track)
    return Chart(title, _note(profile, panels, bool(gaps)), (first, last), tuple(panels), gaps)


def extremes(values: Array, most: int = MOST_POINTS) -> NDArray[np.intp]:
    """Indices that keep the shape of a long trace: per bucket the minimum, the maximum and the first missing value.

    Parameters
    ----------
    values : (n,), NaN where missing
    most : maximum number of indices, not counting those of missing values; a shorter trace is kept whole

    Examples
    --------
    >>> extremes(np.array([0.0, 5.0, 1.0, 2.0, -3.0, 0.0]), most=4)
    array([0, 1, 3, 4, 5])
    """
    if values.size <= most:
        return np.arange(values.size)
    bounds = np.linspace(0, values.size, most // 2 + 1).astype(int)
    starts, sizes = bounds[:-1], np.diff(bounds)
    inside = np.arange(sizes.max()) < sizes[:, None]
    buckets = np.full(inside.shape, np.nan)
    buckets[inside] = values
    missing = inside & ~np.isfinite(buckets)
    known = (inside & ~missing).any(axis=1)
    absent = np.isnan(buckets)
    lowest = starts + np.argmin(np.where(absent, np.inf, buckets), axis=1)
    highest = starts + np.argmax(np.where(absent, -np.inf, buckets), axis=1)
    first_missing = starts + np.argmax(missing, axis=1)
    ends = [0, values.size - 1]
    return np.unique(
        np.concatenate([ends, lowest[known], highest[known], first_missing[missing.any(axis=1)]])
    )


def _note(profile: xr.Dataset, panels: Sequence[ChartPanel], gaps: bool) -> str:
    """What the profile is and how it is drawn, in one line."""
    attributes = (profile.attrs.get(name, "") for name in ("method", "loading", "vehicle"))
    parts = [str(each) for each in attributes if each]
    if any(line.decimated for panel in panels for line in panel.lines):
        parts.append(f"long traces are drawn by the extremes of {MOST_POINTS // 2} pieces")
    if gaps:
        parts.append("shaded: no data")
    return " · ".join(parts)


@dataclass(frozen=True)
class _Track:
    """A profile on a uniform grid [m]; NaN in gaps, be they flagged or rows that are missing."""

    spacing: float
    distance: Array
    elevation: Array
    deviations: Mapping[str, Array]
    sides: Mapping[str, Array]


def _track(profile: xr.Dataset) -> _Track:
    distance = profile["distance"].to_numpy()
    spacing = float(np.median(np.diff(distance)))
    count = int((distance[-1] - distance[0]) / spacing + 0.5) + 1
    grid = np.linspace(distance[0], distance[-1], count)
    deviations = {
        str(name): np.interp(grid, distance, profile[name])
        for name in profile.data_vars
        if str(name).startswith("standard_deviation")
    }
    sides = {
        f"{rail} rail": resample(distance, known_elevation(select_rail(profile, rail)), grid)
        for rail in available_rails(profile)
        if rail in {Rail.LEFT, Rail.RIGHT}
    }
    known = resample(distance, known_elevation(profile), grid)
    return _Track(spacing, grid, known, deviations, sides)


def _elevation_panel(track: _Track) -> ChartPanel:
    interval = _interval(track, track.elevation, "standard_deviation")
    about = "the 95 % interval is ruled by the long waves" if interval else ""
    lines = (_elevation_line(track, track.elevation),)
    return ChartPanel("Elevation", about, "mm", lines, interval, height=1.2)


def _band_panel(track: _Track, band: Band) -> ChartPanel | None:
    """The elevation in a band, None where no piece of the profile can carry it."""
    filtered = band_pass_pieces(track.elevation, track.spacing, band)
    if np.isnan(filtered).all():
        return None
    about = f"RMS {_MILLI * _rms(filtered):.2g} mm"
    key = f"standard_deviation_{band.name}"
    if key in track.deviations:
        stated = track.deviations[key][np.isfinite(filtered)]
        about += f", stated standard deviation {_MILLI * _rms(stated):.2g} mm"
    name = f"{band.name}, {band.shortest:g} to {band.longest:g} m"
    lines = [_elevation_line(track, filtered)]
    for order, (side, elevation) in enumerate(track.sides.items(), start=1):
        apart = band_pass_pieces(elevation, track.spacing, band)
        lines.append(line_of(side, track.distance, _MILLI * apart, order))
    return ChartPanel(name, about, "mm", tuple(lines), _interval(track, filtered, key))


def _elevation_line(track: _Track, elevation: Array) -> ChartLine:
    return line_of(ELEVATION, track.distance, _MILLI * elevation)


def _interval(track: _Track, middle: Array, deviation: str) -> Interval | None:
    """The 95 % interval in mm, where the profile states one."""
    if deviation not in track.deviations:
        return None
    half = _TWO_SIDED_95 * track.deviations[deviation]
    low, high = _MILLI * (middle - half), _MILLI * (middle + half)
    kept = np.union1d(extremes(low), extremes(high))
    return Interval(track.distance[kept], low[kept], high[kept])


def channel_panels(
    channel: Channel, where: Array, model: ArrayLike | None, called: str = MEASURED
) -> list[ChartPanel]:
    """A sensor's signal under the name ``called`` and, where a model reproduces it, what that leaves."""
    unit, factor = _SHOWN_IN[channel.quantity]
    valid = True if channel.valid is None else channel.valid
    measured = factor * np.where(valid, channel.values, np.nan)
    name = channel.quantity.capitalize()
    about = f"{channel.body}, {_place(channel.position, channel.lateral)}"
    lines = [line_of(called, where, measured)]
    if model is None:
        return [ChartPanel(name, about, unit, tuple(lines))]
    signal = factor * np.asarray(model, dtype=float)
    lines.append(line_of(REPRODUCED, where, signal))
    left = measured - signal
    size = f"RMS {_rms(left):.2g} {unit}, of {_rms(measured):.2g} {unit} measured"
    residual = ChartPanel("Residual", size, unit, (line_of(RESIDUAL, where, left),), height=0.6)
    return [ChartPanel(name, about, unit, tuple(lines)), residual]


def _place(position: float, lateral: float) -> str:
    """Such as ``1 m to the left, 2 m ahead of its centre``."""
    aside = f"{abs(lateral):g} m to the {'left' if lateral > 0 else 'right'}"
    if position == 0:
        return aside if lateral else "at its centre"
    along = f"{abs(position):g} m {'ahead of' if position > 0 else 'behind'} its centre"
    return f"{aside}, {along}" if lateral else along


def _sample_distance(recording: xr.Dataset, given: ArrayLike | None) -> Array:
    if given is None and "distance" not in recording:
        raise DataError("The recording has no distance: give sample_distance, one per sample.")
    where = np.asarray(recording["distance"] if given is None else given, dtype=float)
    if where.shape != (recording.sizes["sample"],):
        raise DataError(
            f"sample_distance: expected one per sample, {recording.sizes['sample']}, "
            f"got shape {where.shape}."
        )
    return where


def _check_reproduced(
    reproduced: Mapping[str, ArrayLike], known: tuple[Channel, ...], count: int
) -> None:
    names = [channel.name for channel in known]
    for name, signal in reproduced.items():
        if name not in names:
            raise DataError(f"Reproduced {name}: the recording has only {', '.join(names)}.")
        if np.shape(signal) != (count,):
            raise DataError(
                f"Reproduced {name}: expected one value per sample, {count}, "
                f"got shape {np.shape(signal)}."
            )


def line_of(name: str, x: Array, y: Array, order: int = 0) -> ChartLine:
    """A trace, thinned to its extremes where it is long."""
    kept = extremes(y)
    return ChartLine(name, x[kept], y[kept], kept.size < y.size, order)


def _gaps(track: _Track) -> tuple[tuple[float, float], ...]:
    """From the last known point before each gap to the first after it [m]."""
    last = track.distance.size - 1
    return tuple(
        (float(track.distance[max(gap.start - 1, 0)]), float(track.distance[min(gap.stop, last)]))
        for gap in runs(np.isnan(track.elevation))
    )


def _rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else np.nan
