"""Figures of a profile, a simulation and a calibration: interactive (plotly) or static (matplotlib).

What a figure shows is assembled once, as data (`chart`); `figure_html` (plotly) and `png` (matplotlib) draw it.
Functions return a figure and never show it. They import plotly or matplotlib when they draw, because that import
takes longer than most commands run.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import xarray as xr
from numpy.typing import ArrayLike

from trackprofile.errors import importing_extra
from trackprofile.reporting.figures.chart import Chart, profile_chart

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from plotly.graph_objects import Figure as PlotlyFigure

    from trackprofile.calibration.calibrate import Calibration
    from trackprofile.simulation.simulate import Simulation

__all__ = [
    "calibration_figure",
    "check_png_library",
    "interactive_figure",
    "interactive_profile_figure",
    "interactive_simulation_figure",
    "static_figure",
    "static_profile_figure",
    "static_simulation_figure",
    "write_html",
    "write_png",
]


def interactive_figure(chart: Chart) -> PlotlyFigure:
    """Draw a chart with plotly."""
    with importing_extra("plot", "An HTML figure"):
        from trackprofile.reporting.figures.figure_html import draw

    return draw(chart)


def static_figure(chart: Chart) -> Figure:
    """Draw a chart with matplotlib."""
    with importing_extra("plot", "A PNG figure"):
        from trackprofile.reporting.figures.png import draw

    return draw(chart)


def interactive_profile_figure(
    profile: xr.Dataset,
    recording: xr.Dataset | None = None,
    sample_distance: ArrayLike | None = None,
    reproduced: Mapping[str, ArrayLike] | None = None,
) -> PlotlyFigure:
    """Strip chart of a profile with zoom and tooltips: elevation, D1, D2, and each sensor of the recording.

    Parameters
    ----------
    profile : see `trackprofile.contracts`
    recording : its channels are drawn below the profile
    sample_distance : distance at which each sample was taken, (samples,) [m]; by default the recording's own
        distance
    reproduced : by channel, the signal that the model computes from the profile, (samples,) [the channel's unit]

    Raises
    ------
    DataError : an array does not have the recording's length, a channel is not in the recording, or the
        recording has no distance.

    Examples
    --------
    >>> import numpy as np
    >>> distance = np.arange(0.0, 200.0, 0.25)
    >>> level = ("distance", 0.002 * np.sin(distance))
    >>> wave = xr.Dataset({"elevation": level}, {"distance": distance})
    >>> [trace.name for trace in interactive_profile_figure(wave).data]
    ['elevation', 'elevation', 'elevation']
    """
    return interactive_figure(profile_chart(profile, recording, sample_distance, reproduced or {}))


def static_profile_figure(
    profile: xr.Dataset,
    recording: xr.Dataset | None = None,
    sample_distance: ArrayLike | None = None,
    reproduced: Mapping[str, ArrayLike] | None = None,
) -> Figure:
    """Strip chart of a profile as a matplotlib figure; parameters and errors as `interactive_profile_figure`."""
    return static_figure(profile_chart(profile, recording, sample_distance, reproduced or {}))


def interactive_simulation_figure(
    truth: xr.Dataset, recording: xr.Dataset, simulation: Simulation, title: str
) -> PlotlyFigure:
    """Strip chart of a simulation with zoom and tooltips: profile, signals, contact forces, rail deflections.

    Parameters
    ----------
    truth : the unloaded profile
    recording : signals of the sensors
    simulation : result of `trackprofile.simulation.simulate`
    title : first part of the title
    """
    from trackprofile.reporting.figures.simulation_figure import simulation_chart

    return interactive_figure(simulation_chart(truth, recording, simulation, title))


def static_simulation_figure(
    truth: xr.Dataset, recording: xr.Dataset, simulation: Simulation, title: str
) -> Figure:
    """Strip chart of a simulation as a matplotlib figure; parameters as `interactive_simulation_figure`."""
    from trackprofile.reporting.figures.simulation_figure import simulation_chart

    return static_figure(simulation_chart(truth, recording, simulation, title))


def calibration_figure(calibration: Calibration) -> Figure:
    """Log-posterior along each parameter, and the part of each signal's spectrum that the track explains.

    Parameters
    ----------
    calibration : result of `trackprofile.calibration.calibrate.calibrate`
    """
    with importing_extra("plot", "A PNG figure"):
        from trackprofile.reporting.figures.calibration_figure import draw

    return draw(calibration)


def check_png_library() -> None:
    """Check, before a long computation, that PNG figures can be drawn.

    Raises
    ------
    MissingExtraError : matplotlib is not installed.
    """
    with importing_extra("plot", "A PNG figure"):
        import matplotlib.figure  # noqa: F401


def write_html(figure: PlotlyFigure, path: Path | str) -> None:
    """Write a plotly figure as one self-contained HTML file that needs no network."""
    from trackprofile.reporting.figures.figure_html import html

    Path(path).write_text(html(figure), encoding="utf-8")


def write_png(figure: Figure, path: Path | str) -> None:
    """Write a matplotlib figure as PNG at 150 dots per inch, whatever the suffix of the path."""
    from trackprofile.reporting.figures.png import write

    write(figure, path)
