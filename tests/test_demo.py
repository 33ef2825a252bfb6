from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from trackprofile import read
from trackprofile.contracts import channels
from trackprofile.demo import SAMPLING, run, simulated
from trackprofile.errors import FileError
from trackprofile.io.model_toml import read_sensors, read_spectrum, read_vehicle
from trackprofile.models.sensor import Sensor
from trackprofile.models.spectrum import Spectrum
from trackprofile.models.statespace import state_space, transfer_function
from trackprofile.models.track import RigidTrack

BODY_SENSOR = Sensor("a", "vertical acceleration", "body", 2.0, noise_density=1e-9)


def simulate_demo(seed: int, length: float = 300.0) -> tuple[xr.Dataset, xr.Dataset]:
    vehicle, _ = read_vehicle("velaro")
    return simulated(
        vehicle, RigidTrack(), read_sensors("bogie-25ug"), read_spectrum("fra-6"), length, seed
    )


def test_the_same_seed_gives_the_same_recording() -> None:
    first, again, other = simulate_demo(1)[0], simulate_demo(1)[0], simulate_demo(2)[0]
    assert first.identical(again)
    assert not np.allclose(first["bogie_pitch_rate"], other["bogie_pitch_rate"])


def test_the_recording_states_that_it_is_simulated() -> None:
    recording, truth = simulate_demo(1)
    assert "simulated" in recording.attrs["source"]
    assert truth.attrs["kind"] == "truth"


def test_position_is_the_integral_of_speed() -> None:
    recording, _ = simulate_demo(1)
    time, speed = recording["time"].to_numpy(), recording["speed"].to_numpy()
    np.testing.assert_allclose(np.diff(time), 1 / SAMPLING, rtol=1e-9)
    assert time[0] == 0.0
    run_ = np.sum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))
    assert run_ == pytest.approx(300.0, abs=0.2)
    assert 20.0 <= speed.min() < speed.max() <= 40.0


def test_body_acceleration_agrees_with_the_transfer_function() -> None:
    """The RMS of the body's acceleration is between those of the transfer functions of the speeds."""
    vehicle, _ = read_vehicle("velaro")
    spectrum = Spectrum("short waves", 1e-6, 0.2, 0.5)
    recording, _ = simulated(vehicle, RigidTrack(), (BODY_SENSOR,), spectrum, 3000.0, 5)
    omega = np.linspace(2e-3, 2 * np.pi, 20_000)
    system = state_space(vehicle, RigidTrack(), (BODY_SENSOR,))
    rms = []
    for speed in np.unique(np.round(recording["speed"].to_numpy())):
        response = np.abs(transfer_function(system, omega, float(speed))[:, 0]) ** 2
        rms.append(np.sqrt(np.trapezoid(response * spectrum.density(omega), omega)))
    signal = channels(recording)[0].values
    assert min(rms) < np.std(signal) < max(rms)


def test_the_demo_recovers_the_profile_and_can_be_run_again(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "demo"
    demo = run(folder, length=260.0)
    assert {path.name for path in folder.iterdir()} == {
        *("recording.csv", "recording.toml", "truth.csv", "vehicle.toml"),
        *("profile.nc", "profile.html", "profile.png"),
    }
    band = demo.comparison.bands["D1"]
    assert band is not None
    assert band.correlation > 0.999
    assert band.rms_error_mm < 0.05
    assert read(demo.files[0]).attrs["vehicle"] == "velaro"
    run(folder, length=100.0)


def test_the_demo_does_not_replace_other_files(tmp_path: Path) -> None:
    (tmp_path / "truth.csv").write_text("levelled in 1998")
    with pytest.raises(FileError, match=r"truth\.csv was not written by an earlier demo"):
        run(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["truth.csv"]
    with pytest.raises(FileError, match="cannot be used as a folder"):
        run(tmp_path / "truth.csv")


def test_the_python_example_of_the_readme_runs_on_the_demo(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    readme = Path(__file__).parents[1] / "README.md"
    examples = re.findall("```python\n(.*?)```", readme.read_text(encoding="utf-8"), re.DOTALL)
    assert examples
    monkeypatch.chdir(tmp_path)
    run("demo", length=260.0)
    for example in examples:
        exec(example, {})
    assert "correlation=0.99" in capsys.readouterr().out
