"""Limit sets in TOML files, and presets by name.

    name = "our railway"
    source = "rule book 12, edition 3"

    [[defect]]                              # isolated defects, mean to peak
    band = "D1"
    above = "0 km/h"                        # range of line speed
    up_to = "120 km/h"
    alert = "10 mm"                         # omit actions without a limit
    intervention = "13 mm"
    immediate_action = "26 mm"
    source = "table 4"
    verified = true                         # the numbers were compared with the source

    [[quality_class]]                       # standard deviation of a section
    band = "D1"
    above = "0 km/h"
    up_to = "120 km/h"
    below = { A = "0.75 mm", B = "1.1 mm" } # best first
    beyond = "C"
    source = "table 5"
    verified = true

The tables ``accuracy`` (repeatability and reproducibility of runs) and ``required_action`` (what each action requires,
as text) are optional. In each wavelength band the speed ranges begin at 0 and have no gap.
"""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from trackprofile.assessment import limits as kinds
from trackprofile.assessment.limits import Action, Limits
from trackprofile.errors import FileError
from trackprofile.io.table import error_location
from trackprofile.io.toml_document import Strict, load
from trackprofile.units import quantity

_PRESETS = Path(__file__).parents[1] / "presets" / "limits"


class _Sourced(Strict):
    source: str = Field(min_length=1)
    verified: bool


class _SpeedBand(_Sourced):
    band: str
    above: str
    up_to: str

    @property
    def common(self) -> tuple[str, float, float, str, bool]:
        speeds = (quantity(self.above, "speed"), quantity(self.up_to, "speed"))
        return (self.band, *speeds, self.source, self.verified)


class _Defect(_SpeedBand):
    alert: str | None = None
    intervention: str | None = None
    immediate_action: str | None = None

    def si(self) -> kinds.DefectLimits:
        texts = {action: getattr(self, action.name.lower()) for action in Action}
        heights = {action: quantity(text, "length") for action, text in texts.items() if text}
        return kinds.DefectLimits(*self.common, heights)


class _QualityClass(_SpeedBand):
    below: dict[str, str] = Field(min_length=1)
    beyond: str

    def si(self) -> kinds.QualityClasses:
        below = {name: quantity(text, "length") for name, text in self.below.items()}
        return kinds.QualityClasses(*self.common, below, self.beyond)


class _Accuracy(_Sourced):
    band: str
    repeatability: str
    reproducibility: str

    def si(self) -> kinds.Accuracy:
        pair = (quantity(self.repeatability, "length"), quantity(self.reproducibility, "length"))
        return kinds.Accuracy(self.band, *pair, self.source, self.verified)


class _RequiredAction(_Sourced):
    alert: str
    intervention: str
    immediate_action: str

    def si(self) -> kinds.ActionTexts:
        texts = {action: getattr(self, action.name.lower()) for action in Action}
        return kinds.ActionTexts(texts, self.source, self.verified)


class _Limits(Strict):
    name: str
    source: str = ""
    defect: list[_Defect] = Field(default_factory=list)
    quality_class: list[_QualityClass] = Field(default_factory=list)
    accuracy: list[_Accuracy] = Field(default_factory=list)
    required_action: _RequiredAction | None = None


def limit_presets() -> tuple[str, ...]:
    """Names of the limit sets that are part of the package.

    Examples
    --------
    >>> limit_presets()
    ('en-13848', 'national-example')
    """
    return tuple(sorted(path.stem for path in _PRESETS.glob("*.toml")))


def read_limits(name_or_path: str | Path) -> Limits:
    """Read a limit set from a file or a preset.

    Parameters
    ----------
    name_or_path : name of a preset, such as ``en-13848``, or the path of a TOML file

    Raises
    ------
    FileError : the file does not exist, or a key is missing, unknown or wrong.
    DataError : a unit is wrong, speed ranges overlap or have a gap, or limits do not increase with severity.

    Examples
    --------
    >>> limits = read_limits("en-13848")
    >>> {action.text: round(1e3 * height) for action, height in limits.defects_at("D1", 40.0).heights.items()}
    {'alert': 8, 'intervention': 10, 'immediate action': 23}
    """
    path = _find(name_or_path)
    table = load(path, _Limits)
    with error_location(path):
        if not table.defect and not table.quality_class:
            raise FileError(f"{path}: it has no limits; add a table 'defect' or 'quality_class'.")
        return Limits(
            table.name,
            defects=tuple(one.si() for one in table.defect),
            classes=tuple(one.si() for one in table.quality_class),
            accuracies=tuple(one.si() for one in table.accuracy),
            action_texts=None if table.required_action is None else table.required_action.si(),
            source=table.source,
        )


def _find(name_or_path: str | Path) -> Path:
    if str(name_or_path) in limit_presets():
        return _PRESETS / f"{name_or_path}.toml"
    if not Path(name_or_path).is_file():
        raise FileError(
            f"{name_or_path}: the file does not exist; give the path of a TOML file with limits, "
            f"or one of the presets {', '.join(limit_presets())}."
        )
    return Path(name_or_path)
