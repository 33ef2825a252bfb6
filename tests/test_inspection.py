"""What is said of a logger's file, and that what is written can be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trackprofile.cli import main
from trackprofile.contracts import Channel, build_recording, channels
from trackprofile.errors import FileError
from trackprofile.io import write
from trackprofile.io.column_guess import Role, guess
from trackprofile.io.column_info import ColumnInfo
from trackprofile.io.inspection import write_toml
from trackprofile.preprocessing.faults import FaultKind
from trackprofile.reader import inspect, read


@pytest.fixture
def logger(tmp_path: Path) -> Path:
    rows = "".join(
        f"01.05.2024 12:00:{k // 100:02d},{k % 100:02d};80;{f'{1 + 0.01 * np.sin(k):.4f}'.replace('.', ',')};"
        f"0,1;{f'{np.cos(k):.4f}'.replace('.', ',')};\n"
        for k in range(300)
    )
    head = (
        "Zeit;Geschw [km/h];Beschl. Drehgestell z [g];Gier [°/s];Nickrate Drehgestell [°/s];Bem\n"
    )
    (tmp_path / "logger.csv").write_text("Logger 12;Fw 3\n" + head + rows, encoding="cp1252")
    return tmp_path / "logger.csv"


@pytest.mark.parametrize(
    ("name", "unit", "role", "body"),
    [
        ("bogie_acc_z", "g", Role.VERTICAL, "leading bogie"),
        ("acc lateral body", "m/s²", Role.ACCELERATION, ""),
        ("Beschleunigung Wagenkasten", "m/s²", Role.VERTICAL, "body"),
        ("rear bogie acceleration", "m/s²", Role.VERTICAL, "trailing bogie"),
        ("gyro_pitch_deg_s", "", Role.PITCH, "body"),
        ("yaw rate", "°/s", Role.RATE, ""),
        ("v_gps_kmh", "", Role.GNSS_SPEED, ""),
        ("v_tacho_kmh", "", Role.SPEED, ""),
        ("GPS_Lat", "", Role.LATITUDE, ""),
        ("Längengrad", "°", Role.LONGITUDE, ""),
        ("Radimpulse", "", Role.PULSES, ""),
        ("km-Stein", "km", Role.POST, ""),
        ("Wankrate", "°/s", Role.ROLL, "body"),
        ("bogie_gyro_x", "°/s", Role.ROLL, "leading bogie"),
        ("chainage_km", "", Role.DISTANCE, ""),
        ("t", "s", Role.TIME, ""),
        ("temperature", "°C", Role.OTHER, ""),
        ("channel 7", "m/s^2", Role.VERTICAL, "body"),
    ],
)
def test_role_of_a_column_is_determined_by_name_and_unit(
    name: str, unit: str, role: Role, body: str
) -> None:
    found = guess(ColumnInfo(name, unit), np.arange(9.0))
    assert (found.role, found.body) == (role, body)


@pytest.mark.parametrize(
    ("name", "lateral"),
    [
        ("axle_box_left_acc", 1.0),
        ("Beschl. Radsatz rechts", -1.0),
        ("acc_l", 1.0),
        ("acc.r.z", -1.0),
        ("軸箱 左 加速度", 1.0),
        ("bogie_acc_z", 0.0),
        ("acc left - right", 0.0),
    ],
)
def test_side_of_a_sensor_is_determined_by_the_name(
    name: str, lateral: float, tmp_path: Path
) -> None:
    assert guess(ColumnInfo(name, "m/s²"), np.arange(9.0)).lateral == lateral
    rows = "".join(f"{k},30,{k % 3}\n" for k in range(5))
    (tmp_path / "a.csv").write_text(f"t [s],v [m/s],{name} [m/s²]\n{rows}", encoding="utf-8")
    found = inspect(tmp_path / "a.csv").recording
    assert found is not None
    assert channels(found)[0].lateral == lateral


def test_unstated_units_are_determined_by_the_values() -> None:
    assert guess(ColumnInfo("acc"), np.array([0.99, 1.01])).unit == "g"
    assert guess(ColumnInfo("acc"), np.array([-9.9, -9.7])).unit == "m/s²"
    assert guess(ColumnInfo("speed"), np.array([0.0, 120.0])).unit == "km/h"
    assert not guess(ColumnInfo("speed"), np.array([0.0, 120.0])).sure


def test_unit_of_speed_is_determined_by_distance_over_time(tmp_path: Path) -> None:
    rows = "".join(f"{k},{10 * k},36\n" for k in range(5))
    (tmp_path / "a.csv").write_text("t,distance_m,speed\n" + rows)
    (speed,) = (one for one in inspect(tmp_path / "a.csv").contents if one.heading.name == "speed")
    assert (speed.guess.unit, speed.guess.sure) == ("km/h", True)


def test_written_description_reads_the_file_of_the_logger(logger: Path, tmp_path: Path) -> None:
    found = inspect(logger)
    toml = write_toml(found, tmp_path / "run.toml")
    recording = read(toml)
    assert [(one.quantity, one.body) for one in channels(recording)] == [
        ("vertical acceleration", "leading bogie"),
        ("pitch rate", "leading bogie"),
    ]
    np.testing.assert_allclose(np.diff(recording["time"]), 0.01, atol=1e-6)
    assert found.recording is not None
    assert not found.faults
    assert "# guessed" in toml.read_text(encoding="utf-8")
    with pytest.raises(FileError, match="the file exists already"):
        write_toml(found, toml)


@pytest.mark.parametrize("suffix", [".parquet", ".h5", ".mat", ".mf4", ".tdms"])
def test_every_format_is_inspected(tmp_path: Path, suffix: str) -> None:
    time = np.arange(200) / 100.0
    signal = np.sin(7 * time)
    signal[100:140] = signal[100]
    floor = Channel("floor_acc", signal, "vertical acceleration", "body", 0.0)
    recording = build_recording([floor], time=time, speed=np.full(200, 10.0))
    path = write(recording, tmp_path / f"run{suffix}")[0]
    found = inspect(path)
    roles = {one.heading.name: one.guess.role for one in found.contents}
    assert roles == {"time": Role.TIME, "speed": Role.SPEED, "floor_acc": Role.VERTICAL}
    assert [one.kind for one in found.faults] == [FaultKind.STUCK]
    assert next(one.rate for one in found.contents if one.heading.name == "speed") == pytest.approx(
        100
    )


def test_command_lists_the_content_of_the_file(
    logger: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(logger.parent)
    main(["inspect", "logger.csv", "-o", "run.toml"])  # exits where the command fails
    printed = capsys.readouterr()
    assert "Nickrate Drehgestell [°/s]" in printed.out
    assert "With this guess the file is a recording of 300 samples, 80 to 80 km/h." in printed.err


@pytest.mark.parametrize("contents", [b"", b"\x00\x01" * 40, b"only words\nand more\n"])
def test_a_file_without_numbers_is_refused_in_one_sentence(
    tmp_path: Path, contents: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.csv").write_bytes(contents)
    with pytest.raises(SystemExit) as ended:
        main(["inspect", str(tmp_path / "a.csv")])
    assert ended.value.code == 1
    assert capsys.readouterr().err.count("\n") == 1
