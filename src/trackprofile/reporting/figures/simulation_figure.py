"""Contents of a simulation figure: the profile, the signals, contact forces and rail deflections."""

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
    """Panels of a simulation over the position of the leading wheel.

    Parameters
    ----------
    truth : the unloaded profile
    recording : signals of the sensors
    simulation : motion of vehicle and track
    """
    position = simulation.position
    first, last = float(position[0]), float(position[-1])
    profile = line_of(
        ELEVATION, truth["distance"].to_numpy(), _MILLI * truth["elevation"].to_numpy()
    )
    panels = [ChartPanel("Profile", "unloaded", "mm", (profile,), height=1.2)]
    distance = recording["distance"].to_numpy()
    for channel in channels(recording):
        panels += channel_panels(channel, distance, None, SIMULATED)
    force = _wheel_panel("Contact force", "kN", _KILO, simulation.contact_force, simulation)
    if np.any(simulation.contact_force < 0):
        force = replace(force, description=f"{force.description}: below 0 the wheel would lift off")
    panels.append(force)
    if np.any(simulation.rail_deflection):
        panels.append(
            _wheel_panel("Rail deflection", "mm", _MILLI, simulation.rail_deflection, simulation)
        )
    full_title = f"{title}, {first:.0f} to {last:.0f} m"
    speeds = 3.6 * simulation.speed
    speed_text = f"{speeds.min():.0f} km/h"
    if np.ptp(speeds) > 1.0:
        speed_text = f"{speeds.min():.0f} to {speeds.max():.0f} km/h"
    note = f"{speed_text} · distance of the leading wheel"
    return Chart(full_title, note, (first, last), tuple(panels), ())


def _wheel_panel(
    name: str, unit: str, factor: float, values: np.ndarray, simulation: Simulation
) -> ChartPanel:
    wheels = [part for part, _ in simulation.freedoms[-values.shape[1] :]]
    # The first colour is that of the elevation.
    lines = tuple(
        line_of(wheel, simulation.position, factor * values[:, i], i + 1)
        for i, wheel in enumerate(wheels)
    )
    low, high = factor * float(values.min()), factor * float(values.max())
    return ChartPanel(name, f"{low:.3g} to {high:.3g} {unit}", unit, lines)
