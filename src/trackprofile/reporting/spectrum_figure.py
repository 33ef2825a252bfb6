"""The spectrum of the profile beside the known ones, as a drawing within the page (SVG)."""

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
SHOWN = 5
"""Of the known spectra, the nearest."""

TICKS = (3.0, 5.0, 10.0, 25.0, 50.0, 70.0)  # m


def drawing(found: Psd, known: Mapping[str, Roughness]) -> str:
    """Density of the profile and of the nearest known ones over the wavelength; both axes are logarithmic."""
    omega = found.spatial_frequency
    every_line = {name: np.asarray(one.density(omega)) for name, one in known.items()}
    nearest = sorted(
        every_line,
        key=lambda name: float(np.mean(np.square(np.log(every_line[name] / found.density)))),
    )
    lines = {name: every_line[name] for name in nearest[:SHOWN]}
    every = np.concatenate([found.density, *lines.values()])
    low, high = np.floor(np.log10(every.min())), np.ceil(np.log10(every.max()))
    ends = np.log10([omega[0], omega[-1]])

    def x(value: Array) -> Array:
        return LEFT + (np.log10(value) - ends[0]) / (ends[1] - ends[0]) * (WIDTH - LEFT - RIGHT)

    def y(value: Array) -> Array:
        return TOP + (high - np.log10(value)) / (high - low) * (HEIGHT - TOP - BOTTOM)

    parts = _grid(x, y, omega, low, high)
    for number, (name, values) in enumerate(lines.items()):
        colour = palette.SPECTRA[number % len(palette.SPECTRA)]
        parts.append(_line(x(omega), y(values), colour, 1.2))
        parts.append(_key(number + 1, colour, name))
    parts += [
        _line(x(omega), y(found.density), palette.LEVEL, 2.4),
        _key(0, palette.LEVEL, "this profile"),
    ]
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
    for wavelength in TICKS:
        place = 2 * np.pi / wavelength
        if omega[0] <= place <= omega[-1]:
            at = float(x(np.array(place)))
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


def _key(number: int, colour: str, name: str) -> str:
    at = TOP + 14.0 * (number + 1)
    left = WIDTH - RIGHT + 10
    return (
        f'<path d="M{left} {at - 4}h16" stroke="{colour}" stroke-width="3"/>'
        f'<text x="{left + 22}" y="{at}">{escape(name)}</text>'
    )
