"""A known reference profile: its spline coefficients, and the signals of a run over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import solve_banded

from trackprofile.bands import D1, band_pass, resample
from trackprofile.errors import DataError
from trackprofile.inference.observations import DEFAULT_SPECTRUM, KNOT_SPACING, Observations
from trackprofile.kalman import simulation_kernels
from trackprofile.kalman.smoother import InitialState
from trackprofile.kalman.time_steps import DiscretisedRun
from trackprofile.kalman.transition_kernels import COLUMNS
from trackprofile.models.spectrum import Spectrum, scale_density
from trackprofile.models.vehicle import Vehicle

Array = NDArray[np.float64]

ORIGIN_SEARCH = 15.0
"""Distance to each side of the stated origin in which the calibration searches for it, m."""


@dataclass(frozen=True)
class KnownProfile:
    """A reference profile as spline coefficients.

    Parameters
    ----------
    coefficients : (count,), m; ``coefficients[i]`` has the index ``first + i``
    first : index of the first coefficient
    begin, end : of the reference, m
    spectrum : of the default shape, with the reference's own level in D1
    """

    coefficients: Array
    first: int
    begin: float
    end: float
    spectrum: Spectrum

    @staticmethod
    def from_reference(reference: xr.Dataset) -> KnownProfile:
        """The spline through the reference at its knots; DataError where it has gaps."""
        distance, elevation = reference["distance"].to_numpy(), reference["elevation"].to_numpy()
        if not np.all(np.isfinite(elevation)):
            raise DataError(
                "The reference has gaps in its elevation; choose a stretch without gaps with --from and --to."
            )
        first = int(np.ceil(distance[0] / KNOT_SPACING))
        last = int(np.floor(distance[-1] / KNOT_SPACING))
        at_knots = resample(distance, elevation, np.arange(first, last + 1) * KNOT_SPACING)
        return KnownProfile(
            _spline_through(at_knots),
            first,
            float(distance[0]),
            float(distance[-1]),
            _scaled_spectrum(at_knots),
        )

    def covered(self, data: Observations, vehicle: Vehicle, origin: float) -> Observations:
        """The part of a recording whose wheels run on the reference for every origin of the search."""
        at = data.motion.distance + origin
        low = self.begin + vehicle.length + ORIGIN_SEARCH + 1.0
        inside = (at >= low) & (at <= self.end - ORIGIN_SEARCH - 1.0)
        if np.sum(inside) < 2 or np.ptp(at[inside]) < 2 * vehicle.length:
            raise DataError(
                f"The reference ({self.begin:.0f} m to {self.end:.0f} m) covers less than two lengths of the vehicle "
                f"of the recording ({at[0]:.0f} m to {at[-1]:.0f} m); the fit needs {ORIGIN_SEARCH:.0f} m "
                f"more at each end: choose another stretch or reference."
            )
        return data.part(inside)

    def response(self, run: DiscretisedRun, start: InitialState) -> Array:
        """Signals (rows, 1) of a run over the reference, from quasi-static equilibrium on it."""
        slots = (run.bases[:, :, None] + np.arange(COLUMNS) - self.first).reshape(
            len(run.bases), -1
        )
        slots = np.clip(slots, 0, len(self.coefficients) - 1)
        window = np.arange(run.first_knot, run.first_knot + run.ring)
        window_coefficients = np.empty(run.ring)
        window_coefficients[window % run.ring] = self.coefficients[
            np.clip(window - self.first, 0, len(self.coefficients) - 1)
        ]
        signals = np.empty(len(run.rows))
        simulation_kernels.responded(
            start.quasi_static_gain @ window_coefficients,
            self.coefficients,
            run.F,
            run.G,
            slots,
            run.rows,
            run.first_row,
            signals,
        )
        return signals[:, None]


def _scaled_spectrum(elevation: Array) -> Spectrum:
    """The default spectrum, scaled to the variance in D1 of an elevation at the knots."""
    variance = float(np.var(band_pass(elevation, KNOT_SPACING, D1)))
    deviation = DEFAULT_SPECTRUM.standard_deviation(D1.shortest, D1.longest)
    return scale_density(DEFAULT_SPECTRUM, variance / deviation**2)


def _spline_through(values: Array) -> Array:
    """Coefficients of the cubic B-spline through values at its knots, with zero curvature at both ends."""
    n = len(values)
    bands = np.zeros((3, n))
    bands[0, 1:], bands[1], bands[2, :-1] = 1 / 6, 4 / 6, 1 / 6
    # r'' = 0 at the ends: c_0 = 2 c_1 - c_2, so the first row is c_1 = r.
    bands[1, 0] = bands[1, -1] = 1.0
    bands[0, 1] = bands[2, -2] = 0.0
    inner = solve_banded((1, 1), bands, values)
    return np.concatenate([[2 * inner[0] - inner[1]], inner, [2 * inner[-1] - inner[-2]]])
