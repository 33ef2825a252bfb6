"""A profile that is known: as spline coefficients, with the signals that a ride over it makes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import solve_banded

from trackprofile.bands import D1, band_pass, resample
from trackprofile.errors import DataError
from trackprofile.inference.observations import DEFAULT_SPECTRUM, KNOT_SPACING, Observations
from trackprofile.kalman import simulation_kernels as forward_kernels
from trackprofile.kalman.smoother import InitialState
from trackprofile.kalman.time_steps import DiscretisedRun
from trackprofile.kalman.transition_kernels import COLUMNS
from trackprofile.models.spectrum import Spectrum, scale_density
from trackprofile.models.vehicle import Vehicle

Array = NDArray[np.float64]

SEARCHED_ORIGINS = 15.0
"""m around the stated origin in which it is looked for before anything else is fitted."""


@dataclass(frozen=True)
class KnownProfile:
    """A reference as spline coefficients: ``coefficients[i]`` is that of index ``first + i``.

    ``spectrum`` has the usual shape and the reference's own level in D1.
    """

    coefficients: Array
    first: int
    begin: float
    end: float
    spectrum: Spectrum

    @staticmethod
    def of(reference: xr.Dataset) -> KnownProfile:
        """The spline through the reference at its knots; DataError where it has gaps."""
        distance, elevation = reference["distance"].to_numpy(), reference["elevation"].to_numpy()
        if not np.all(np.isfinite(elevation)):
            raise DataError(
                "The reference has gaps in its elevation; choose a stretch without with --from and --to."
            )
        first = int(np.ceil(distance[0] / KNOT_SPACING))
        last = int(np.floor(distance[-1] / KNOT_SPACING))
        at_knots = resample(distance, elevation, np.arange(first, last + 1) * KNOT_SPACING)
        return KnownProfile(
            _spline_through(at_knots),
            first,
            float(distance[0]),
            float(distance[-1]),
            _of_that_level(at_knots),
        )

    def covered(self, data: Observations, vehicle: Vehicle, origin: float) -> Observations:
        """The part of a recording whose wheels run on the reference, wherever the origin is searched."""
        at = data.motion.distance + origin
        low = self.begin + vehicle.length + SEARCHED_ORIGINS + 1.0
        inside = (at >= low) & (at <= self.end - SEARCHED_ORIGINS - 1.0)
        if np.sum(inside) < 2 or np.ptp(at[inside]) < 2 * vehicle.length:
            raise DataError(
                f"The reference ({self.begin:.0f} m to {self.end:.0f} m) covers less than two lengths of the vehicle "
                f"of the recording ({at[0]:.0f} m to {at[-1]:.0f} m); the fit needs {SEARCHED_ORIGINS:.0f} m "
                f"more at each end: choose another stretch or reference."
            )
        return data.part(inside)

    def response(self, ride: DiscretisedRun, start: InitialState) -> Array:
        """The signals (rows, 1) of a ride over the reference, from standing on it quasi-statically."""
        places = (ride.bases[:, :, None] + np.arange(COLUMNS) - self.first).reshape(
            len(ride.bases), -1
        )
        places = np.clip(places, 0, len(self.coefficients) - 1)
        window = np.arange(ride.first_knot, ride.first_knot + ride.ring)
        below = np.empty(ride.ring)
        below[window % ride.ring] = self.coefficients[
            np.clip(window - self.first, 0, len(self.coefficients) - 1)
        ]
        signals = np.empty(len(ride.rows))
        forward_kernels.responded(
            start.stance @ below,
            self.coefficients,
            ride.F,
            ride.G,
            places,
            ride.rows,
            ride.first_row,
            signals,
        )
        return signals[:, None]


def _of_that_level(elevation: Array) -> Spectrum:
    """The usual spectrum, scaled to the variance in D1 of an elevation at the knots."""
    variance = float(np.var(band_pass(elevation, KNOT_SPACING, D1)))
    usual = DEFAULT_SPECTRUM.standard_deviation(D1.shortest, D1.longest)
    return scale_density(DEFAULT_SPECTRUM, variance / usual**2)


def _spline_through(values: Array) -> Array:
    """Coefficients of the cubic B-spline through values at its knots; one more at each end, straight there."""
    n = len(values)
    bands = np.zeros((3, n))
    bands[0, 1:], bands[1], bands[2, :-1] = 1 / 6, 4 / 6, 1 / 6
    # r'' = 0 at the ends: c_0 = 2 c_1 - c_2, so that the first row reads c_1 = r.
    bands[1, 0] = bands[1, -1] = 1.0
    bands[0, 1] = bands[2, -2] = 0.0
    inner = solve_banded((1, 1), bands, values)
    return np.concatenate([[2 * inner[0] - inner[1]], inner, [2 * inner[-1] - inner[-2]]])
