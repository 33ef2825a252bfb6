from __future__ import annotations

import math
import tomllib
from importlib.resources import files
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackprofile.errors import FileError, ModelError, TrackprofileError, UnitError
from trackprofile.io.model_toml import (
    check_vehicle_path,
    presets,
    read_roughness,
    read_sensors,
    read_spectrum,
    read_track,
    read_vehicle,
    write_vehicle,
)
from trackprofile.io.toml_document import toml_text
from trackprofile.models.sensor import Installation, Sensor
from trackprofile.models.spectrum import PowerLaw, SpectrumSegment
from trackprofile.models.track import ElasticTrack, LayeredTrack, RigidTrack, SupportChange
from trackprofile.models.vehicle import (
    ROLL_FIELDS,
    Body,
    Link,
    Vehicle,
    VehicleParameter,
    Wheel,
    parameter_values,
    with_parameters,
)

EXAMPLE = Path(__file__).parents[1] / "examples" / "hokuriku" / "vehicle.toml"

CART = """
name = "cart"
[parameter.load]
value = 2
unit = "t"
source = "weighed"
[[body]]
name = "body"
mass = "load"
[[wheel]]
name = "wheel"
mass = 100
position = 0
[[link]]
name = "spring"
upper = "body"
lower = "wheel"
position = 0
stiffness = 1e6
damping = 2e4
"""

TRACK = """
name = "soft"
stiffness = { value = 50, unit = "MN/m" }
damping = { value = 30, unit = "kN s/m" }
"""


def put(folder: Path, text: str) -> Path:
    path = folder / "model.toml"
    path.write_text(text, encoding="utf-8")
    return path


# --- presets ------------------------------------------------------------------------------------


def test_quarter_car_has_the_parameters_of_table_1_of_the_paper() -> None:
    assert parameter_values(read_vehicle("quarter-car")[0]) == {
        "body mass": 7900.0,
        "bogie mass": 512.5,
        "secondary stiffness": 7.3e5,
        "secondary damping": 15_000.0,
        "primary stiffness": 5e5,
        "primary damping": 5_000.0,
    }


def test_velaro_has_the_parameters_of_table_2_of_the_paper() -> None:
    vehicle, installation = read_vehicle("velaro")
    of_roll = {one.name for one in vehicle.parameters if one.used_by[0][1] in ROLL_FIELDS}
    values = parameter_values(vehicle)
    assert {name: values[name] for name in values if name not in of_roll} == {
        "body mass": 47_800.0,
        "body pitch inertia": 1.96e6,
        "bogie mass": 3_500.0,
        "bogie pitch inertia": 1_715.0,
        "wheelset mass": 1_800.0,
        "secondary stiffness": 0.7e6,
        "secondary damping": 40e3,
        "primary stiffness": 2.4e6,
        "primary damping": 20e3,
    }
    assert installation == Installation()
    assert [wheel.position for wheel in vehicle.wheels] == [0.0, 2.5, 17.375, 19.875]
    assert (
        vehicle.body("trailing bogie").position - vehicle.body("leading bogie").position == 17.375
    )
    assert vehicle.body("body").position == vehicle.length / 2


@pytest.mark.parametrize("vehicle", [read_vehicle("velaro")[0], read_vehicle(EXAMPLE)[0]])
def test_springs_connect_parts_at_the_same_position(vehicle: Vehicle) -> None:
    places = {part.name: part.position for part in (*vehicle.bodies, *vehicle.wheels)}
    for link in vehicle.links:
        end = link.lower  # a bogie below the body, a wheel below a bogie
        assert link.position == places[end]
    centres = [places[name] for name in ("leading bogie", "trailing bogie")]
    assert sum(centres) / 2 == pytest.approx(places["body"], rel=1e-15)


def test_example_car_has_the_measured_distances_and_marks_typical_values() -> None:
    vehicle, _ = read_vehicle(EXAMPLE)
    first, second, third, _ = (wheel.position for wheel in vehicle.wheels)
    assert (second - first, third - first) == (2.1, 13.8)
    body = vehicle.body("body")
    assert body.pitch_inertia
    assert math.sqrt(body.pitch_inertia / body.mass) == 5.5
    assert all("not verified" in one.source for one in vehicle.parameters)


def test_the_zhai_track_is_the_one_fitted_below_30_hz() -> None:
    track = read_track("zhai")
    assert isinstance(track, ElasticTrack)
    assert (track.stiffness, track.damping) == (87.8e6, 36e3)
    assert read_track("rigid") == RigidTrack()


@pytest.mark.parametrize(
    ("name", "amplitude", "corner_high", "d1_mm"),
    [
        ("fra-4", 2.39e-5, 0.825, 7.58),
        ("fra-5", 9.35e-6, 0.825, 4.74),
        ("fra-6", 1.5e-6, 0.825, 1.90),
        ("german-low", 4.032e-7, 0.8246, 0.984),
        ("german-high", 1.080e-6, 0.8246, 1.61),
    ],
)
def test_the_spectra_have_their_coefficients_and_standard_deviations(
    name: str, amplitude: float, corner_high: float, d1_mm: float
) -> None:
    spectrum = read_spectrum(name)
    assert (spectrum.amplitude, spectrum.corner_low, spectrum.corner_high) == (
        amplitude,
        0.0206,
        corner_high,
    )
    assert 1e3 * spectrum.standard_deviation(3.0, 25.0) == pytest.approx(d1_mm, abs=0.005)


LAW = """
name = "law"
shortest = { value = 1000, unit = "mm" }
longest = { value = 100, unit = "m" }
[[segment]]
end = { value = 0.5, unit = "1/m" }
density = { value = 2, unit = "mm²/(1/m)" }
reference = { value = 0.1, unit = "1/m" }
slope = 3
[[segment]]
density = { value = 2, unit = "cm²/(rad/m)" }
reference = { value = 1, unit = "rad/m" }
slope = 0
corner = { frequency = { value = 1, unit = "rad/m" }, added_slope = 3, sharpness = 1.5 }
"""


def test_a_power_law_is_read_in_si(tmp_path: Path) -> None:
    whole = 2 * math.pi
    assert read_roughness(put(tmp_path, LAW)) == PowerLaw(
        "law",
        (
            SpectrumSegment(2e-6 / whole, 0.1 * whole, 3.0, end=0.5 * whole),
            SpectrumSegment(2e-4, 1.0, 0.0, corner_frequency=1.0, added_slope=3.0, sharpness=1.5),
        ),
        shortest=1.0,
        longest=100.0,
    )


@pytest.mark.parametrize(
    ("old", "new", "kind", "words"),
    [
        ('"mm²/(1/m)"', '"mm²"', FileError, ("segment 1.density.unit", "'mm²/(1/m)'")),
        ("slope = 3", "slop = 3", FileError, ("'slop'", "segment 1", "slope")),
        ("value = 100,", "value = 1,", ModelError, ("'law'", "shortest < longest")),
        ('unit = "mm"', 'unit = "kg"', UnitError, ("'kg'", "length")),
        (
            "added_slope = 3",
            "added_slope = 0",
            FileError,
            ("segment 2.corner.added_slope", "greater than 0"),
        ),
    ],
)
def test_an_impossible_power_law_is_refused_naming_the_file(
    tmp_path: Path, old: str, new: str, kind: type[TrackprofileError], words: tuple[str, ...]
) -> None:
    assert old in LAW
    path = put(tmp_path, LAW.replace(old, new, 1))
    with pytest.raises(kind) as caught:
        read_roughness(path)
    message = str(caught.value)
    assert message.count(str(path)) == 1
    assert message.startswith(str(path))
    assert all(word in message for word in words), message


def test_a_power_law_is_refused_as_prior_naming_the_file(tmp_path: Path) -> None:
    path = put(tmp_path, LAW)
    with pytest.raises(ModelError, match="cannot be a prior") as caught:
        read_spectrum(path)
    assert str(caught.value).startswith(str(path))


def test_the_sensor_grades_are_those_of_the_limits_table() -> None:
    grades = []
    for name in ("bogie-1ug", "bogie-25ug", "bogie-100ug", "bogie-1mg"):
        acceleration, rate = read_sensors(name)
        assert acceleration.body == rate.body == "leading bogie"
        assert acceleration.noise_density
        assert rate.noise_density
        grades.append((acceleration.noise_density / 9.80665e-6, rate.noise_density * 180 / math.pi))
    expected = [(1.0, 0.002), (25.0, 0.005), (100.0, 0.01), (1000.0, 0.1)]
    assert sorted(grades) == [pytest.approx(one, rel=1e-12) for one in expected]


def test_every_preset_is_read_and_has_a_source() -> None:
    for kind, reads in {"vehicle": read_vehicle, "spectrum": read_roughness}.items():
        for name in presets(kind):  # type: ignore[arg-type]
            read = reads(name)
            assert (read[0] if isinstance(read, tuple) else read).source
    assert presets("track") == ("rigid", "zhai", "zhai-layered")


# --- round trip ---------------------------------------------------------------------------------

text = st.text(max_size=12)
positive = st.floats(1e-3, 1e9)
distance = st.floats(-50.0, 50.0)


@st.composite
def vehicles(draw: st.DrawFn) -> Vehicle:
    names = draw(st.lists(text, min_size=9, max_size=9, unique=True))
    shared = draw(st.lists(text, min_size=3, max_size=3, unique=True))
    stiffness, mass = draw(positive), draw(positive)
    bodies = (
        Body(names[0], draw(positive), draw(st.none() | positive), draw(distance)),
        Body(names[1], mass, None, draw(distance)),
        Body(names[2], mass, draw(positive), draw(distance)),
    )
    wheels = (Wheel(names[3], draw(positive), 0.0), Wheel(names[4], draw(positive), 7.5))
    links = (
        Link(names[5], names[0], names[1], draw(distance), stiffness, draw(positive)),
        Link(names[6], names[1], names[3], draw(distance), draw(positive), draw(positive)),
        Link(names[7], names[2], names[4], draw(distance), stiffness, 0.0),
    )
    parameters = (
        VehicleParameter(
            shared[0], "N/m", ((names[5], "stiffness"), (names[7], "stiffness")), draw(text)
        ),
        VehicleParameter(shared[1], "kg", ((names[1], "mass"), (names[2], "mass")), draw(text)),
        VehicleParameter(shared[2], "m", ((names[4], "position"),), ""),
    )
    return Vehicle(names[8], bodies, links, wheels, draw(text), parameters)


@st.composite
def installations(draw: st.DrawFn) -> Installation:
    optional = st.none() | positive
    sensors = tuple(
        Sensor(
            draw(text),
            quantity,
            draw(text),
            noise_density=draw(optional),
            bandwidth=draw(optional),
            offset=draw(optional),
            flicker=draw(optional),
        )
        for quantity in draw(st.lists(st.sampled_from(["vertical acceleration", "pitch rate"])))
    )
    return Installation(draw(distance), sensors, draw(optional))


@given(vehicles(), installations())
def test_a_vehicle_is_read_back_exactly(
    tmp_path_factory: pytest.TempPathFactory, vehicle: Vehicle, installation: Installation
) -> None:
    path = tmp_path_factory.mktemp("round") / "vehicle.toml"
    write_vehicle(vehicle, installation, path)
    assert read_vehicle(path) == (vehicle, installation)


def test_a_shared_parameter_is_written_once_and_read_into_all_parts(
    tmp_path: Path,
) -> None:
    vehicle = with_parameters(read_vehicle("velaro")[0], {"primary stiffness": 1.234567e6})
    write_vehicle(vehicle, Installation(), tmp_path / "v.toml")
    back, _ = read_vehicle(tmp_path / "v.toml")
    assert [link.stiffness for link in back.links if "primary" in link.name] == [1.234567e6] * 4
    assert (tmp_path / "v.toml").read_text().count("1234567.0") == 1


def test_a_calibration_is_kept_and_marks_its_parameters(tmp_path: Path) -> None:
    calibration = {
        "parameters": {"body mass": {"value": 47_800.0, "standard_error": 12.5}},
        "correlation": [[1.0, -0.25], [-0.25, 1.0]],
        "notes": ["held: wheelset mass"],
        "track": "rigid",
        "converged": True,
        "runs": [{"from_m": 75.0}, {"from_m": None, "to_m": 2}],
    }
    path = tmp_path / "v.toml"
    write_vehicle(*read_vehicle("velaro"), path, calibration)
    raw = tomllib.loads(path.read_text(encoding="utf-8"))
    assert raw["calibration"] == calibration | {"runs": [{"from_m": 75.0}, {"to_m": 2}]}
    assert raw["parameter"]["body mass"]["standard_error"] == 12.5
    sources = {one.name: one.source for one in read_vehicle(path)[0].parameters}
    assert sources["body mass"] == "calibrated"
    assert sources["bogie mass"] == "Table 2, m_b"


key = st.text(min_size=1, max_size=6)
leaf = st.booleans() | st.integers(-(2**60), 2**60) | st.floats(allow_nan=False) | st.text()
value = st.recursive(
    leaf, lambda one: st.lists(one, max_size=3) | st.dictionaries(key, one, max_size=3)
)


@given(st.dictionaries(key, value, max_size=4))
def test_any_document_is_read_back_unchanged(table: dict[str, object]) -> None:
    assert tomllib.loads(toml_text(table)) == table


# --- bad input ----------------------------------------------------------------------------------


def test_units_of_parameters_are_converted_on_reading(tmp_path: Path) -> None:
    assert read_vehicle(put(tmp_path, CART))[0].body("body").mass == 2000.0
    track = read_track(put(tmp_path, TRACK))
    assert isinstance(track, ElasticTrack)
    assert (track.stiffness, track.damping) == (50e6, 30e3)


@pytest.mark.parametrize(
    ("old", "new", "kind", "words"),
    [
        ('unit = "t"', 'unit = "N"', UnitError, ("parameter 'load'", "'N'", "kg, t")),
        ("mass = 100", 'mass = "tare"', ModelError, ("'tare'", "load")),
        ("mass = 100", "mass = true", FileError, ("wheel 1.mass", "name of a parameter")),
        ("mass = 100", "mass = nan", FileError, ("wheel 1.mass", "expected a number")),
        ('mass = "load"', "mass = 1", ModelError, ("is not used", "'load'")),
        ("value = 2", "value = -2", ModelError, ("'body'", "above 0")),
        ("stiffness = 1e6", "stifness = 1e6", FileError, ("'stifness'", "stiffness")),
        ("value = 2", "valu = 2", FileError, ("'valu'", "parameter.load", "standard_error")),
        ("value = 2", "value = 0x", FileError, ("not valid TOML",)),
        ('lower = "wheel"', 'lower = "well"', ModelError, ("'spring'", "'well'")),
        ('[[wheel]]\nname = "wheel"', '[[wheel]]\nname = "body"', ModelError, ("named 'body'",)),
        ('name = "cart"', "", FileError, ("'name' is missing",)),
    ],
)
def test_an_impossible_vehicle_is_refused_naming_the_file(
    tmp_path: Path, old: str, new: str, kind: type[TrackprofileError], words: tuple[str, ...]
) -> None:
    assert old in CART
    path = put(tmp_path, CART.replace(old, new, 1))
    with pytest.raises(kind) as caught:
        read_vehicle(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert all(word in message for word in words), message


def test_a_sensor_of_the_wrong_unit_is_refused(tmp_path: Path) -> None:
    sensor = 'name = "a"\nquantity = "pitch rate"\nbody = "body"\nunit = "mg"\n'
    path = put(tmp_path, CART + "[[installation.sensor]]\n" + sensor)
    with pytest.raises(UnitError, match=r"sensor 'a'.*'mg'.*rad/s"):
        read_vehicle(path)


def test_a_track_without_stiffness_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"model\.toml.*stiffness above 0"):
        read_track(put(tmp_path, TRACK.replace("50", "0")))


@pytest.mark.parametrize(
    ("read", "preset"),
    [(read_vehicle, "velaro"), (read_track, "rigid"), (read_spectrum, "fra-6")],
)
def test_an_unknown_name_is_refused_with_the_presets(read, preset) -> None:
    with pytest.raises(FileError, match=rf"nowhere: the file does not exist.*{preset}"):
        read("nowhere")


def test_writing_a_vehicle_does_not_replace_another_file(tmp_path: Path) -> None:
    path = put(tmp_path, TRACK)
    with pytest.raises(FileError, match="is not a vehicle"):
        write_vehicle(*read_vehicle("velaro"), path)
    assert path.read_text(encoding="utf-8") == TRACK
    with pytest.raises(FileError, match=r"ends in \.toml"):
        check_vehicle_path(tmp_path / "vehicle.json")
    check_vehicle_path(put(tmp_path, CART))


def test_layered_track_is_read_with_its_changes(tmp_path: Path) -> None:
    whole = (files("trackprofile") / "presets/track/zhai-layered.toml").read_text()
    spot = """
[[change]]
field = "ballast_stiffness"
factor = 0.3
start = { value = 100, unit = "m" }
end = { value = 103, unit = "m" }
"""
    track = read_track(put(tmp_path, whole + spot))
    assert isinstance(track, LayeredTrack)
    assert track.changes == (SupportChange("ballast_stiffness", 0.3, 100.0, 103.0),)
    assert track.support.pad_stiffness == 65e6


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (("value = 125.5", "value = -125.5"), "sleeper mass must be above 0, got -125.5"),
        (("value = 0.545", "value = 0"), "spacing must be above 0, got 0"),
        (("value = 60.64", "value = -1"), "rail mass must be above 0"),
        (("[rail]", '[rail]\ncolour = "red"'), "colour"),
    ],
)
def test_impossible_layered_track_is_refused(
    tmp_path: Path, wrong: tuple[str, str], said: str
) -> None:
    whole = (files("trackprofile") / "presets/track/zhai-layered.toml").read_text()
    path = put(tmp_path, whole.replace(*wrong))
    with pytest.raises(TrackprofileError, match=said) as caught:
        read_track(path)
    assert str(path) in str(caught.value)
