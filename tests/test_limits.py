"""Limits files: what they hold, and what is refused in one sentence."""

from __future__ import annotations

from pathlib import Path

import pytest

from trackprofile.assessment.limits import Action, Limits, SpeedBand, unverified
from trackprofile.assessment.limits_toml import limit_presets, read_limits
from trackprofile.errors import DataError, FileError

KM_H = 1 / 3.6

DEFECT = """
[[defect]]
band = "D1"
above = "{above} km/h"
up_to = "{up_to} km/h"
alert = "{alert} mm"
immediate_action = "26 mm"
source = "a rule"
verified = true
"""


def toml(*speeds: tuple[float, float], alert: float = 10.0) -> str:
    tables = (DEFECT.format(above=a, up_to=b, alert=alert) for a, b in speeds)
    return 'name = "ours"\n' + "".join(tables)


def refused(folder: Path, text: str) -> str:
    path = folder / "ours.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises((DataError, FileError)) as caught:
        read_limits(path)
    sentence = str(caught.value)
    assert sentence.startswith(str(path))
    assert sentence.endswith(".")
    assert "\n" not in sentence
    return sentence


@pytest.mark.parametrize(
    ("speed", "heights"),
    [(80, (12, 17, 28)), (81, (10, 13, 26)), (160, (8, 10, 23)), (300, (6, 8, 16))],
)
def test_en_13848_has_the_heights_of_the_line_speed(
    speed: float, heights: tuple[int, int, int]
) -> None:
    found = read_limits("en-13848").defects_at("D1", speed * KM_H)
    assert found is not None
    assert tuple(round(1e3 * found.heights[action], 6) for action in Action) == heights


def test_en_13848_has_no_limits_in_d2_below_160_km_h() -> None:
    limits = read_limits("en-13848")
    below, above = (limits.defects_at("D2", speed * KM_H) for speed in (150, 170))
    assert below is not None
    assert above is not None
    assert not below.heights
    assert above.heights[Action.IMMEDIATE_ACTION] == pytest.approx(0.033)


def test_only_the_two_rows_that_were_read_in_a_source_count_as_verified() -> None:
    limits = read_limits("en-13848")
    assert not any(one.verified for one in limits.defects)
    assert [one.speeds for one in limits.classes if one.verified] == [
        "80 to 120 km/h",
        "120 to 160 km/h",
    ]
    assert any("not verified against the standard" in one for one in unverified(limits, ["D1"], 40))


@pytest.mark.parametrize("name", limit_presets())
def test_every_preset_says_where_each_number_comes_from(name: str) -> None:
    limits = read_limits(name)
    ones = (*limits.defects, *limits.classes, *limits.accuracies, limits.action_texts)
    assert all(one is not None and one.source for one in ones)


def test_speed_bands_that_overlap_leave_a_hole_or_begin_late_are_refused(tmp_path: Path) -> None:
    assert "0 to 80 km/h and 70 to 120 km/h overlap" in refused(tmp_path, toml((0, 80), (70, 120)))
    assert "no speed range covers 80 to 90 km/h" in refused(tmp_path, toml((0, 80), (90, 120)))
    assert "no speed range covers 0 to 40 km/h" in refused(tmp_path, toml((40, 80)))
    assert "expected above < up_to" in refused(tmp_path, toml((0, 80), (80, 80)))


def test_limits_that_do_not_rise_or_cannot_be_read_are_refused(tmp_path: Path) -> None:
    assert "increase with severity, got 30, 26 mm" in refused(tmp_path, toml((0, 80), alert=30))
    text = toml((0, 80))
    assert "key 'verified' is missing" in refused(tmp_path, text.replace("verified = true", ""))
    assert "unknown key 'alarm'" in refused(tmp_path, text.replace("alert", "alarm"))
    assert "is not a length" in refused(tmp_path, text.replace("10.0 mm", "ten"))
    assert "'km'" in refused(tmp_path, text.replace("80 km/h", "80 km"))
    assert "it has no limits" in refused(tmp_path, 'name = "ours"')
    with pytest.raises(FileError, match="one of the presets en-13848, national-example"):
        read_limits("en-13849")


def test_a_speed_beyond_all_bands_is_refused() -> None:
    with pytest.raises(
        DataError, match=r"expected a speed above 0 and up to 300 km/h, got 320 km/h"
    ):
        read_limits("en-13848").defects_at("D1", 320 * KM_H)


def test_a_band_without_any_table_has_no_limits() -> None:
    assert Limits("ours").defects_at("D3", 10.0) is None
    assert SpeedBand("D1", 0.0, 80 * KM_H, "", True).speeds == "0 to 80 km/h"
