"""Power spectral density of a profile with reference spectra, as SVG within the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from html import escape

import numpy as np
from numpy.typing import NDArray

from trackprofile.assessment.roughness import Psd
from trackprofile.models.spectrum import Roughness
from trackprofile.reporting import palette

Array = NDArray[np.float64]
Scale = Callable[[Array], Array]

WIDTH, HEIGHT = 640.0, 320.0
LEFT, RIGHT, TOP, BOTTOM = 64.0, 150.0, 10.0, 34.0
MAX_REFERENCES = 5
"""Number of reference spectra that are drawn: the nearest."""

WAVELENGTH_TICKS = (3.0, 5.0, 10.0, 25.0, 50.0, 70.0)  # m


def spectrum_svg(spectrum: Psd, references: Mapping[str, Roughness]) -> str:
    """Density of the profile and of the nearest reference spectra over wavelength; both axes are logarithmic."""
    omega = spectrum.spatial_frequency
    densities = {name: np.asarray(one.density(omega)) for name, one in references.items()}
    nearest = sorted(
        densities,
        key=lambda name: float(np.mean(np.square(np.log(densities[name] / spectrum.density)))),
    )
    shown = {name: densities[name] for name in nearest[:MAX_REFERENCES]}
    values = np.concatenate([spectrum.density, *shown.values()])
    low, high = np.floor(np.log10(values.min())), np.ceil(np.log10(values.max()))
    ends = np.log10([omega[0], omega[-1]])

    def x(value: Array) -> Array:
        return LEFT + (np.log10(value) - ends[0]) / (ends[1] - ends[0]) * (WIDTH - LEFT - RIGHT)

    def y(value: Array) -> Array:
        return TOP + (high - np.log10(value)) / (high - low) * (HEIGHT - TOP - BOTTOM)

    parts = _grid(x, y, omega, low, high)
    for number, (name, density) in enumerate(shown.items()):
        colour = palette.SPECTRA[number % len(palette.SPECTRA)]
        parts.append(_line(x(omega), y(density), colour, 1.2))
        parts.append(_legend_entry(number + 1, colour, name))
    parts.append(_line(x(omega), y(spectrum.density), palette.LEVEL, 2.4))
    parts.append(_legend_entry(0, palette.LEVEL, "this profile"))
    return (
        f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" style="max-width:{WIDTH:g}px;width:100%" role="img" '
        f'aria-label="power spectral density over wavelength" font-size="11">{"".join(parts)}</svg>'
    )


def _grid(x: Scale, y: Scale, omega: Array, low: float, high: float) -> list[str]:
    bottom, right = HEIGHT - BOTTOM, WIDTH - RIGHT
    parts = []
    for power in np.arange(low, high + 1):
        at = float(y(np.array(10.0**power)))
        parts.append(f'<path d="M{LEFT} {at:.1f}H{right}" stroke="{palette.GRID}"/>')
        parts.append(
            f'<text x="{LEFT - 5}" y="{at + 4:.1f}" text-anchor="end">1e{power:.0f}</text>'
        )
    for wavelength in WAVELENGTH_TICKS:
        frequency = 2 * np.pi / wavelength
        if omega[0] <= frequency <= omega[-1]:
            at = float(x(np.array(frequency)))
            parts.append(f'<path d="M{at:.1f} {TOP}V{bottom}" stroke="{palette.GRID}"/>')
            parts.append(
                f'<text x="{at:.1f}" y="{bottom + 14}" text-anchor="middle">{wavelength:g} m</text>'
            )
    middle = (LEFT + right) / 2
    parts.append(
        f'<text x="{middle}" y="{HEIGHT - 4}" text-anchor="middle">wavelength; density in m²/(rad/m), one-sided</text>'
    )
    return parts


def _line(x: Array, y: Array, colour: str, width: float) -> str:
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    return f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{width}"/>'


def _legend_entry(number: int, colour: str, name: str) -> str:
    at = TOP + 14.0 * (number + 1)
    left = WIDTH - RIGHT + 10
    return (
        f'<path d="M{left} {at - 4}h16" stroke="{colour}" stroke-width="3"/>'
        f'<text x="{left + 22}" y="{at}">{escape(name)}</text>'
    )
