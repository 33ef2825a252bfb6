"""What is drawn of a simulation, as data: the profile, the signals, forces and deflections under the wheels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr

from trackprofile.contracts import channels
from trackprofile.reporting.figures.chart import (
    ELEVATION,
    SIMULATED,
    Chart,
    ChartPanel,
    channel_panels,
    line_of,
)
from trackprofile.simulation.simulate import Simulation

_MILLI, _KILO = 1e3, 1e-3


def simulation_chart(
    truth: xr.Dataset, recording: xr.Dataset, simulation: Simulation, title: str
) -> Chart:
    """Put a simulation into panels, over the position of the leading wheel.

    Parameters
    ----------
    truth : the unloaded profile
    recording : what the sensors made of it
    simulation : all that moved
    """
    at = simulation.position
    first, last = float(at[0]), float(at[-1])
    profile = line_of(
        ELEVATION, truth["distance"].to_numpy(), _MILLI * truth["elevation"].to_numpy()
    )
    panels = [ChartPanel("Profile", "unloaded", "mm", (profile,), height=1.2)]
    where = recording["distance"].to_numpy()
    for channel in channels(recording):
        panels += channel_panels(channel, where, None, SIMULATED)
    force = _under_wheels("Contact force", "kN", _KILO, simulation.contact_force, simulation)
    if np.any(simulation.contact_force < 0):
        force = replace(force, about=f"{force.about}: below 0 the wheel would lift off")
    panels.append(force)
    if np.any(simulation.rail_deflection):
        panels.append(
            _under_wheels("Rail deflection", "mm", _MILLI, simulation.rail_deflection, simulation)
        )
    span = f"{title}, {first:.0f} to {last:.0f} m"
    speeds = 3.6 * simulation.speed
    ran = f"{speeds.min():.0f} km/h"
    if np.ptp(speeds) > 1.0:
        ran = f"{speeds.min():.0f} to {speeds.max():.0f} km/h"
    note = f"{ran} · distance is that of the leading wheel"
    return Chart(span, note, (first, last), tuple(panels), ())


def _under_wheels(
    name: str, unit: str, factor: float, values: np.ndarray, simulation: Simulation
) -> ChartPanel:
    wheels = [part for part, _ in simulation.freedoms[-values.shape[1] :]]
    # From the second colour on: the first is the elevation's.
    lines = tuple(
        line_of(wheel, simulation.position, factor * values[:, i], i + 1)
        for i, wheel in enumerate(wheels)
    )
    low, high = factor * float(values.min()), factor * float(values.max())
    return ChartPanel(name, f"{low:.3g} to {high:.3g} {unit}", unit, lines)
