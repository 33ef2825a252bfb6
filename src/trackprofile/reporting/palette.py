"""Colours of all figures, reports and the web viewer, defined once.

The base colours are those of Okabe and Ito (2008), which colour-blind readers can distinguish. Python code uses the
constants; style sheets and scripts use the custom properties of `palette_css`.
"""

from __future__ import annotations

from trackprofile.assessment.limits import Action

BLUE, SKY_BLUE, ORANGE, GREEN = "#0072B2", "#56B4E9", "#E69F00", "#009E73"
VERMILION, PURPLE, YELLOW, GREY = "#D55E00", "#CC79A7", "#F0E442", "#8C8C8C"
OLIVE, INDIGO, RED = "#999933", "#332288", "#B00020"

INK, MUTED, DARK_GREY, LIGHT_GREY = "#222222", "#55606A", "#555555", "#BBBBBB"
GRID, AXIS, PAPER = "#E5E5E5", "#9AA4AD", "#FFFFFF"

LEVEL, INTERVAL, COMPARED, MISSING = BLUE, SKY_BLUE, "#F0B27A", LIGHT_GREY
"""Level, its 95 % interval, the level of another profile, and stretches without data."""

ACTIONS = {Action.ALERT: ORANGE, Action.INTERVENTION: VERMILION, Action.IMMEDIATE_ACTION: RED}
"""Colour of each action, in figures and marks."""

ACTION_TEXT = {
    Action.ALERT: "#855C00",
    Action.INTERVENTION: "#B34E00",
    Action.IMMEDIATE_ACTION: RED,
}
"""Colour of each action, in text: darker where the contrast on white would be below 4.5."""

POSSIBLE = "#7A8794"
"""Defects whose limits are exceeded with a probability below 50 %."""

LINES = (BLUE, ORANGE, GREEN, PURPLE, VERMILION, SKY_BLUE, GREY)
"""Lines that have no colour of their own, in order."""

SPECTRA = (ORANGE, GREEN, PURPLE, VERMILION, GREY, SKY_BLUE, OLIVE, INDIGO)
"""Reference spectra, in order."""

CLASSES = (GREEN, SKY_BLUE, YELLOW, ORANGE, VERMILION, RED)
"""Quality classes of sections, from the best."""

CERTAINTY = ("#00336F", "#3F4F6B", "#6B6B70", "#8F8A78", "#B9AC70", "#E3D057", "#FFEA46")
"""Standard deviations from low to high, of rising lightness: readable without colour (after cividis)."""


def palette_css() -> str:
    """All colours as CSS custom properties, for style sheets and scripts.

    Examples
    --------
    >>> "--immediate-action: #B00020;" in palette_css()
    True
    """
    properties = {
        "ink": INK, "muted": MUTED, "grid": GRID, "axis": AXIS, "paper": PAPER, "level": LEVEL,
        "interval": INTERVAL, "compared": COMPARED, "missing": MISSING, "possible": POSSIBLE,
        **{_property(action): colour for action, colour in ACTIONS.items()},
        **{f"{_property(action)}-text": colour for action, colour in ACTION_TEXT.items()},
        **{f"class-{number}": colour for number, colour in enumerate(CLASSES)},
        **{f"certainty-{number}": colour for number, colour in enumerate(CERTAINTY)},
    }  # fmt: skip
    lines = "\n".join(f"  --{name}: {colour};" for name, colour in properties.items())
    return f":root {{\n{lines}\n}}\n"


def _property(action: Action) -> str:
    return action.name.lower().replace("_", "-")
