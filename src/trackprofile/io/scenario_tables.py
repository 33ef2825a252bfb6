"""Keys and value types of the TOML document of a scenario; `trackprofile.scenario` shows an example."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, NonNegativeInt, PositiveInt
from pydantic_core import PydanticCustomError

from trackprofile.errors import FileError, UnitError
from trackprofile.io import UnlocatedRecording, read
from trackprofile.io.model_tables import InstrumentTable
from trackprofile.io.model_toml import read_roughness
from trackprofile.io.toml_document import Strict
from trackprofile.models.integrate import PAPER_THETA
from trackprofile.models.irregularity import Bell, Dip, Irregularity, Sampled, random_irregularity
from trackprofile.models.track import SupportChange
from trackprofile.units import quantity


def preset_or_path(name: str, beside: Path) -> str | Path:
    """File of that name in the folder of the scenario if it exists; else the name, which is then that of a preset."""
    return beside / name if (beside / name).is_file() else name


def si_value(dimension: str, value: object) -> float:
    """Value of a key, text with a number and its unit, in SI units."""
    problem = f"expected text with a number and a unit of {dimension}"
    try:
        if isinstance(value, str):
            return quantity(value, dimension)
    except UnitError as error:
        problem = str(error).rstrip(".")
    raise PydanticCustomError("quantity", "{problem}", {"problem": problem})


def _speed_schedule(value: object) -> object:
    """Speed schedule; a single speed becomes a schedule of one row."""
    return value if isinstance(value, list) else [{"time": "0 s", "speed": value}]


Length = Annotated[float, BeforeValidator(partial(si_value, "length"))]
Time = Annotated[float, BeforeValidator(partial(si_value, "time"))]
Speed = Annotated[float, BeforeValidator(partial(si_value, "speed"))]
Frequency = Annotated[float, BeforeValidator(partial(si_value, "frequency"))]


class SpeedTable(Strict):
    time: Time
    speed: Speed


class RunTable(Strict):
    start: Length
    end: Length
    speed: Annotated[list[SpeedTable], BeforeValidator(_speed_schedule)]
    run_in: Length = 100.0


class IntegrationTable(Strict):
    scheme: Literal["newmark", "wilson"] = "newmark"
    steps_per_sample: PositiveInt
    theta: float = PAPER_THETA


class BellTable(Strict):
    kind: Literal["bell"]
    depth: Length
    width: Length
    centre: Length

    def made(self, beside: Path, span: tuple[float, float]) -> Irregularity:
        """The same in SI units."""
        return Bell(self.depth, self.width, self.centre)


class DipTable(Strict):
    kind: Literal["dip"]
    depth: Length
    half_length: Length
    position: Length
    count: PositiveInt = 1
    spacing: Length = 25.0

    def made(self, beside: Path, span: tuple[float, float]) -> Irregularity:
        """The same in SI units."""
        return Dip(self.depth, self.half_length, self.position, self.count, self.spacing)


class RandomTable(Strict):
    kind: Literal["random"]
    spectrum: str
    seed: NonNegativeInt
    shortest: Length = 1.5
    longest: Length = 100.0

    def made(self, beside: Path, span: tuple[float, float]) -> Irregularity:
        """The same in SI units."""
        spectrum = read_roughness(preset_or_path(self.spectrum, beside))
        return random_irregularity(
            spectrum, self.seed, self.shortest, self.longest, length=span[1] - span[0]
        )


class FileTable(Strict):
    kind: Literal["file"]
    path: str

    def made(self, beside: Path, span: tuple[float, float]) -> Irregularity:
        """Irregularity of the profile in the file; refused if the profile does not cover the span."""
        profile = read(beside / self.path)
        if isinstance(profile, UnlocatedRecording) or profile.attrs["kind_of_data"] != "profile":
            raise FileError(
                f"{self.path}: expected a profile, got a recording; give a file with distance and elevation."
            )
        made = Sampled(profile["distance"].to_numpy(), profile["elevation"].to_numpy())
        made.at(np.array(span))
        return made


class ChangeTable(Strict):
    field: str
    factor: float
    start: Length
    end: Length

    def made(self) -> SupportChange:
        """The same in SI units."""
        return SupportChange(self.field, self.factor, self.start, self.end)


IRREGULARITY_TABLES: dict[str, type[Strict]] = {
    "bell": BellTable, "dip": DipTable, "random": RandomTable, "file": FileTable
}  # fmt: skip


def _refuse_unknown_keys(table: Any) -> Any:
    """Refuse an unknown key of an irregularity, naming the keys of its kind."""
    kind = IRREGULARITY_TABLES.get(str(table.get("kind"))) if isinstance(table, dict) else None
    unknown = [key for key in table if key not in kind.model_fields] if kind else []
    if kind and unknown:
        raise PydanticCustomError(
            "key", "unknown key {key}; the keys of this table are {known}",
            {"key": repr(unknown[0]), "known": ", ".join(kind.model_fields)},
        )  # fmt: skip
    return table


AnyIrregularity = Annotated[
    BellTable | DipTable | RandomTable | FileTable,
    Field(discriminator="kind"),
    BeforeValidator(_refuse_unknown_keys),
]


class ScenarioTable(Strict):
    source: str = ""
    vehicle: str
    track: str = "rigid"
    sensors: str | None = None
    sensor: list[InstrumentTable] = Field(default_factory=list)
    sampling: Frequency
    anti_alias: bool = True
    seed: NonNegativeInt = 0
    run: RunTable
    integration: IntegrationTable
    irregularity: list[AnyIrregularity] = Field(default_factory=list)
    change: list[ChangeTable] = Field(default_factory=list)
