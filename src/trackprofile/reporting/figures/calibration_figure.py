"""Figure of a calibration: log-posterior along each parameter, and the spectrum of each signal with its parts."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from trackprofile.calibration.bandwidth import SpectralFit
from trackprofile.calibration.calibrate import Calibration
from trackprofile.calibration.likelihood_profiles import LikelihoodProfile, likelihood_profiles
from trackprofile.models.sensor import Sensor
from trackprofile.reporting import palette
from trackprofile.reporting.figures.chart import COLOURS, ELEVATION, MEASURED, REPRODUCED, RESIDUAL

_COLUMNS = 3
_WIDTH, _HEIGHT = 3.7, 2.5  # inches, of one panel
_LOWEST = -5.0  # log-posterior relative to its maximum


def draw(calibration: Calibration) -> Figure:
    """One panel for each parameter, then one for each sensor's spectrum."""
    profiles = likelihood_profiles(calibration.fit, calibration.start)
    sensors = calibration.installation.sensors
    rows = -(-len(profiles) // _COLUMNS), -(-len(sensors) // _COLUMNS)
    figure = Figure(figsize=(_COLUMNS * _WIDTH, sum(rows) * _HEIGHT + 0.8), layout="constrained")
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=rows)[:, 0]
    above.suptitle(
        "Log-posterior along each parameter, minus its maximum", x=0.01, ha="left", fontsize=11
    )
    below.suptitle("Spectrum of each signal and its parts", x=0.01, ha="left", fontsize=11)
    for axes, profile in zip(_panels(above, rows[0], len(profiles)), profiles, strict=True):
        _draw_profile(axes, profile)
    for axes, sensor, part in zip(
        _panels(below, rows[1], len(sensors)), sensors, calibration.spectral_fits, strict=True
    ):
        _draw_spectrum(axes, sensor, part)
    return figure


def _panels(figure: SubFigure, rows: int, count: int) -> list[Axes]:
    panels = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    for axes in panels[count:]:
        axes.set_axis_off()
    return list(panels[:count])


def _draw_profile(axes: Axes, profile: LikelihoodProfile) -> None:
    axes.plot(
        profile.values, profile.loss, "o-", color=COLOURS[ELEVATION], label="log-posterior", ms=3
    )
    axes.plot(
        profile.values, profile.expected, "--", color=COLOURS[REPRODUCED],
        label="from the standard error", lw=1,
    )  # fmt: skip
    axes.plot(
        profile.values, profile.prior - np.max(profile.prior), ":", color=COLOURS[MEASURED],
        label="prior only",
    )  # fmt: skip
    axes.set(ylim=(_LOWEST, 0.3))
    axes.set_title(profile.name, loc="left", fontsize=9, weight="bold")
    axes.set_xlabel(profile.unit, fontsize=8)
    axes.tick_params(labelsize=7)
    axes.locator_params(axis="x", nbins=4)
    axes.legend(fontsize=6.5, frameon=False, loc="lower center")


def _draw_spectrum(axes: Axes, sensor: Sensor, part: SpectralFit) -> None:
    f = part.frequency[1:]
    axes.loglog(f, part.measured[1:], color=COLOURS[MEASURED], lw=0.7, label="signal")
    axes.loglog(
        f, part.track[1:], color=COLOURS[ELEVATION], lw=1, label="track, through the vehicle"
    )
    axes.loglog(f, part.noise[1:], color=COLOURS[RESIDUAL], lw=1, label="unexplained")
    if part.stated is not None:
        axes.axhline(part.stated**2, color=COLOURS[RESIDUAL], ls="--", lw=0.8, label="sensor noise")
    if part.highest > 0:
        axes.axvline(part.highest, color=palette.DARK_GREY, lw=0.8, ls=":", label="usable below")
    top = float(np.max(part.measured[1:]))
    axes.set_ylim(bottom=max(1e-8 * top, 0.3 * float(np.min(part.noise[1:]))), top=3 * top)
    axes.set_title(sensor.name, loc="left", fontsize=9, weight="bold")
    axes.set_xlabel("Hz", fontsize=8)
    axes.set_ylabel("unit² / Hz", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.legend(fontsize=6.5, frameon=False, loc="lower left")
