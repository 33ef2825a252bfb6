"""Pictures of a profile and of how well it explains the recording.

What is drawn is put together once, as data (`chart`); `page` (plotly, to look around in) and
`picture` (matplotlib, for a report) only draw it. Figures are returned, never shown. Both are
imported when they draw, for importing plotly or matplotlib takes longer than most commands run.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import xarray as xr
from numpy.typing import ArrayLike

from trackprofile.reporting.figures.chart import chart_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from plotly.graph_objects import Figure as Page

    from trackprofile.calibration.calibrate import Calibration
    from trackprofile.simulation.simulate import Simulation

__all__ = [
    "calibration_picture",
    "profile_figure",
    "profile_picture",
    "ride_figure",
    "ride_picture",
    "write_html",
    "write_png",
]


def profile_figure(
    profile: xr.Dataset,
    recording: xr.Dataset | None = None,
    sample_distance: ArrayLike | None = None,
    reproduced: Mapping[str, ArrayLike] | None = None,
) -> Page:
    """The strip chart of a profile, to look around in: elevation, D1, D2, and each sensor.

    Parameters
    ----------
    profile : as of `contracts`
    recording : whose channels are drawn below the profile
    sample_distance : where on the profile each of its samples was taken (samples) [m]; by
        default the recording's own distance
    reproduced : by channel, what the model makes of the profile (samples) [the channel's unit]

    Raises
    ------
    DataError : a length that is not the recording's, a channel that it does not have, or no
        distance.

    Examples
    --------
    >>> import numpy as np
    >>> distance = np.arange(0.0, 200.0, 0.25)
    >>> level = ("distance", 0.002 * np.sin(distance))
    >>> wave = xr.Dataset({"elevation": level}, {"distance": distance})
    >>> [trace.name for trace in profile_figure(wave).data]
    ['elevation', 'elevation', 'elevation']
    """
    from trackprofile.reporting.figures.figure_html import draw

    return draw(chart_of(profile, recording, sample_distance, reproduced or {}))


def profile_picture(
    profile: xr.Dataset,
    recording: xr.Dataset | None = None,
    sample_distance: ArrayLike | None = None,
    reproduced: Mapping[str, ArrayLike] | None = None,
) -> Figure:
    """The same chart as a still picture; parameters and errors as of `profile_figure`."""
    from trackprofile.reporting.figures.png import draw

    return draw(chart_of(profile, recording, sample_distance, reproduced or {}))


def ride_figure(
    truth: xr.Dataset, recording: xr.Dataset, simulation: Simulation, title: str
) -> Page:
    """The strip chart of a simulation, to look around in: profile, signals, contact forces, rail deflections.

    Parameters
    ----------
    truth : the unloaded profile
    recording : what the sensors read
    simulation : of `trackprofile.simulation.simulate`
    title : what it is of
    """
    from trackprofile.reporting.figures.figure_html import draw
    from trackprofile.reporting.figures.simulation_figure import ride_chart

    return draw(ride_chart(truth, recording, simulation, title))


def ride_picture(
    truth: xr.Dataset, recording: xr.Dataset, simulation: Simulation, title: str
) -> Figure:
    """The same chart as a still picture; parameters as of `ride_figure`."""
    from trackprofile.reporting.figures.png import draw
    from trackprofile.reporting.figures.simulation_figure import ride_chart

    return draw(ride_chart(truth, recording, simulation, title))


def calibration_picture(calibration: Calibration) -> Figure:
    """How sharply each parameter is told, and what of each signal's spectrum the track explains.

    Parameters
    ----------
    calibration : of `trackprofile.calibration.calibrate.calibrate`
    """
    from trackprofile.reporting.figures.calibration_figure import draw

    return draw(calibration)


def write_html(figure: Page, path: Path | str) -> None:
    """Write a page that holds all it needs and asks nothing of any network."""
    from trackprofile.reporting.figures.figure_html import html

    Path(path).write_text(html(figure), encoding="utf-8")


def write_png(figure: Figure, path: Path | str) -> None:
    """Write a picture at 150 dots per inch, whatever the path's suffix."""
    figure.savefig(path, format="png", dpi=150)
