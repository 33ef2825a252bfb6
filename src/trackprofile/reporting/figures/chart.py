"""The contents of a figure as data, independent of the plotting library."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from trackprofile.arrays import NORMAL_95, runs
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

MAX_POINTS = 4000
"""Maximum number of points of a line, about; a longer one is reduced to its extremes."""

_MILLI = 1e3
_UNITS = {
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
    """A line: NaN interrupts it. x in m, y in the panel's unit; ``order`` chooses a colour for a name without one."""

    name: str
    x: Array
    y: Array
    decimated: bool = False
    order: int = 0

    @property
    def colour(self) -> str:
        """Colour in both plotting libraries."""
        return COLOURS.get(self.name, palette.LINES[self.order % len(palette.LINES)])

    @property
    def width(self) -> float:
        """Width in both plotting libraries [px]."""
        return WIDTHS.get(self.name, OTHER_WIDTH)


@dataclass(frozen=True)
class Interval:
    """An area between two lines. x in m, low and high in the panel's unit."""

    x: Array
    low: Array
    high: Array

    def outline(self) -> tuple[Array, Array]:
        """Closed polygons, one for each stretch without gaps, separated by NaN."""
        xs, ys = [np.empty(0)], [np.empty(0)]
        for run in runs(np.isfinite(self.low)):
            xs += [self.x[run], self.x[run][::-1], [np.nan]]
            ys += [self.low[run], self.high[run][::-1], [np.nan]]
        return np.concatenate(xs), np.concatenate(ys)


@dataclass(frozen=True)
class ChartPanel:
    """One strip of the chart: name, description, unit, contents, and height relative to the others."""

    name: str
    description: str
    unit: str
    lines: tuple[ChartLine, ...]
    interval: Interval | None = None
    height: float = 1.0


@dataclass(frozen=True)
class Chart:
    """Panels over one distance axis; the ends of the axis and of the gaps in m."""

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
    """Panels of a profile and its recording; parameters and errors as `figures.interactive_profile_figure`."""
    track = _track(profile)
    panels = [_elevation_panel(track)]
    panels += [panel for band in (D1, D2) if (panel := _band_panel(track, band))]
    if recording is not None:
        distance = _sample_distance(recording, sample_distance)
        recorded = channels(recording)
        _check_reproduced(reproduced, recorded, distance.size)
        for channel in recorded:
            panels += channel_panels(channel, distance, reproduced.get(channel.name))
    line = "" if recording is None else str(recording.attrs.get("line", ""))
    first, last = float(track.distance[0]), float(track.distance[-1])
    title = f"Track profile{', ' + line if line else ''}, {first:.0f} to {last:.0f} m"
    gaps = _gaps(track)
    return Chart(title, _note(profile, panels, bool(gaps)), (first, last), tuple(panels), gaps)


def extremes(values: Array, max_points: int = MAX_POINTS) -> NDArray[np.intp]:
    """Indices that keep the shape of a long line: per bucket the minimum, the maximum and the first missing value.

    Parameters
    ----------
    values : (n,), NaN where missing
    max_points : maximum number of indices, not counting those of missing values; a shorter line is kept whole

    Examples
    --------
    >>> extremes(np.array([0.0, 5.0, 1.0, 2.0, -3.0, 0.0]), max_points=4)
    array([0, 1, 3, 4, 5])
    """
    if values.size <= max_points:
        return np.arange(values.size)
    bounds = np.linspace(0, values.size, max_points // 2 + 1).astype(int)
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
    """Properties of the profile and of the drawing, in one line."""
    attributes = (profile.attrs.get(name, "") for name in ("method", "loading", "vehicle"))
    parts = [str(each) for each in attributes if each]
    if any(line.decimated for panel in panels for line in panel.lines):
        parts.append(f"long lines are drawn by the extremes of {MAX_POINTS // 2} segments")
    if gaps:
        parts.append("shaded: no data")
    return " · ".join(parts)


@dataclass(frozen=True)
class _Track:
    """A profile on a uniform grid [m]; NaN in gaps, whether flagged or missing rows."""

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
    description = "long wavelengths dominate the 95 % interval" if interval else ""
    lines = (_elevation_line(track, track.elevation),)
    return ChartPanel("Elevation", description, "mm", lines, interval, height=1.2)


def _band_panel(track: _Track, band: Band) -> ChartPanel | None:
    """The level in a band; None if the profile is too short for the band."""
    filtered = band_pass_pieces(track.elevation, track.spacing, band)
    if np.isnan(filtered).all():
        return None
    description = f"RMS {_MILLI * _rms(filtered):.2g} mm"
    key = f"standard_deviation_{band.name}"
    if key in track.deviations:
        stated = track.deviations[key][np.isfinite(filtered)]
        description += f", stated standard deviation {_MILLI * _rms(stated):.2g} mm"
    name = f"{band.name}, {band.shortest:g} to {band.longest:g} m"
    lines = [_elevation_line(track, filtered)]
    for order, (side, elevation) in enumerate(track.sides.items(), start=1):
        one_rail = band_pass_pieces(elevation, track.spacing, band)
        lines.append(line_of(side, track.distance, _MILLI * one_rail, order))
    return ChartPanel(name, description, "mm", tuple(lines), _interval(track, filtered, key))


def _elevation_line(track: _Track, elevation: Array) -> ChartLine:
    return line_of(ELEVATION, track.distance, _MILLI * elevation)


def _interval(track: _Track, middle: Array, deviation: str) -> Interval | None:
    """The 95 % interval [mm]; None if the profile states none."""
    if deviation not in track.deviations:
        return None
    half = NORMAL_95 * track.deviations[deviation]
    low, high = _MILLI * (middle - half), _MILLI * (middle + half)
    kept = np.union1d(extremes(low), extremes(high))
    return Interval(track.distance[kept], low[kept], high[kept])


def channel_panels(
    channel: Channel, distance: Array, model: ArrayLike | None, label: str = MEASURED
) -> list[ChartPanel]:
    """Panel of a sensor's signal, named ``label``, and of its residual if a model reproduces the signal."""
    unit, factor = _UNITS[channel.quantity]
    valid = True if channel.valid is None else channel.valid
    measured = factor * np.where(valid, channel.values, np.nan)
    name = channel.quantity.capitalize()
    description = f"{channel.body}, {_position(channel.position, channel.lateral)}"
    lines = [line_of(label, distance, measured)]
    if model is None:
        return [ChartPanel(name, description, unit, tuple(lines))]
    signal = factor * np.asarray(model, dtype=float)
    lines.append(line_of(REPRODUCED, distance, signal))
    residual = measured - signal
    size = f"RMS {_rms(residual):.2g} {unit}, of {_rms(measured):.2g} {unit} measured"
    line = line_of(RESIDUAL, distance, residual)
    panel = ChartPanel("Residual", size, unit, (line,), height=0.6)
    return [ChartPanel(name, description, unit, tuple(lines)), panel]


def _position(position: float, lateral: float) -> str:
    """Position of a sensor, such as ``1 m to the left, 2 m ahead of its centre``."""
    sideways = f"{abs(lateral):g} m to the {'left' if lateral > 0 else 'right'}"
    if position == 0:
        return sideways if lateral else "at its centre"
    along = f"{abs(position):g} m {'ahead of' if position > 0 else 'behind'} its centre"
    return f"{sideways}, {along}" if lateral else along


def _sample_distance(recording: xr.Dataset, sample_distance: ArrayLike | None) -> Array:
    if sample_distance is None and "distance" not in recording:
        raise DataError(
            "The recording has no distance: give sample_distance, one value per sample."
        )
    values = recording["distance"] if sample_distance is None else sample_distance
    distance = np.asarray(values, dtype=float)
    if distance.shape != (recording.sizes["sample"],):
        raise DataError(
            f"sample_distance: expected one value per sample, {recording.sizes['sample']}, "
            f"got shape {distance.shape}."
        )
    return distance


def _check_reproduced(
    reproduced: Mapping[str, ArrayLike], recorded: tuple[Channel, ...], count: int
) -> None:
    names = [channel.name for channel in recorded]
    for name, signal in reproduced.items():
        if name not in names:
            raise DataError(f"Reproduced {name}: the recording has only {', '.join(names)}.")
        if np.shape(signal) != (count,):
            raise DataError(
                f"Reproduced {name}: expected one value per sample, {count}, "
                f"got shape {np.shape(signal)}."
            )


def line_of(name: str, x: Array, y: Array, order: int = 0) -> ChartLine:
    """A line, reduced to its extremes if it is long."""
    kept = extremes(y)
    return ChartLine(name, x[kept], y[kept], kept.size < y.size, order)


def _gaps(track: _Track) -> tuple[tuple[float, float], ...]:
    """Gaps, each from the last known point before it to the first after it [m]."""
    last = track.distance.size - 1
    return tuple(
        (float(track.distance[max(gap.start - 1, 0)]), float(track.distance[min(gap.stop, last)]))
        for gap in runs(np.isnan(track.elevation))
    )


def _rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else np.nan
