"""Cross-entropy method: small seeded cases, comparison with the direct solution, and rejected inputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

from trackprofile.contracts import Channel, Quality, build_recording
from trackprofile.errors import DataError, ModelError
from trackprofile.io.model_toml import read_track, read_vehicle
from trackprofile.methods.cross_entropy import cross_entropy_kernels as kernels
from trackprofile.methods.cross_entropy.estimator import (
    cross_entropy,
    sensor_weights,
)
from trackprofile.methods.cross_entropy.forward_model import forward_model
from trackprofile.methods.cross_entropy.optimisation import SearchRun, optimise, solve_phase
from trackprofile.methods.cross_entropy.search_settings import (
    TABLE_5,
    TABLE_6,
    CrossEntropySettings,
    Evaluation,
    Objective,
    SearchSettings,
    Variant,
)
from trackprofile.methods.registry import INTERRUPTED
from trackprofile.models.integrate import wilson
from trackprofile.models.irregularity import Bell
from trackprofile.models.sensor import PITCH_RATE, VERTICAL_ACCELERATION, Sensor

Array = NDArray[np.float64]

QUARTER_CAR, _ = read_vehicle("quarter-car")
VELARO, _ = read_vehicle("velaro")
BALLASTED = read_track("zhai-layered")
BOGIE = (Sensor("acceleration", VERTICAL_ACCELERATION, "bogie"),)
LEADING = (
    Sensor("acceleration", VERTICAL_ACCELERATION, "leading bogie"),
    Sensor("pitch", PITCH_RATE, "leading bogie"),
)


def simulated(whole: bool, length: float) -> tuple[xr.Dataset, Array]:
    """A recording over a bell by the model that the search uses, and the true elevations."""
    vehicle, track, sensors = (
        (VELARO, BALLASTED, LEADING) if whole else (QUARTER_CAR, read_track("rigid"), BOGIE)
    )
    speed, step = (150 / 3.6, 2e-3) if whole else (30.0, 0.025 / 30.0)
    count = round(length / speed / step)
    time = np.linspace(0.0, step * count, count + 1)
    car = forward_model(
        vehicle, track, sensors, wilson(step), speed * time, np.full(count + 1, speed)
    )
    r = Bell(depth=1e-3, width=0.5, centre=0.5 * length).at(car.position)[0]
    r[: car.before] = 0.0
    y = np.vstack([np.zeros(len(sensors)), car.signals(r, 0, count)])
    parts = [Channel(s.name, y[:, i], s.quantity, s.body, 0.0) for i, s in enumerate(sensors)]
    recording = build_recording(
        parts, time=time, distance=speed * time, speed=np.full(count + 1, speed)
    )
    return recording, r[car.before :]


@pytest.fixture(scope="module")
def model_a() -> tuple[xr.Dataset, Array]:
    return simulated(whole=False, length=4.0)


@pytest.fixture(scope="module")
def model_b() -> tuple[xr.Dataset, Array]:
    return simulated(whole=True, length=8.0)


def maximum_error(profile: xr.Dataset, truth: Array) -> float:
    return float(np.abs(profile["elevation"].to_numpy() - truth).max())


def test_model_a_recovers_a_bell(model_a: tuple[xr.Dataset, Array]) -> None:
    recording, truth = model_a
    found = cross_entropy(recording, QUARTER_CAR)
    assert maximum_error(found.profile, truth) < 1e-6
    assert found.profile.attrs["kind"] == "point"
    assert found.profile.attrs["loading"] == "loaded"
    assert not found.stopped
    assert np.all(found.profile["quality"] == 0)
    signal = recording["acceleration"].to_numpy()
    np.testing.assert_allclose(
        found.reproduced["acceleration"][1:], signal[1:], atol=1e-3 * np.abs(signal).max()
    )


@pytest.mark.parametrize("variant", Variant)
@pytest.mark.parametrize("objective", Objective)
def test_model_b_recovers_a_bell(
    model_b: tuple[xr.Dataset, Array], variant: Variant, objective: Objective
) -> None:
    recording, truth = model_b
    search = replace(TABLE_6, variant=variant, objective=objective)
    found = cross_entropy(recording, VELARO, CrossEntropySettings(track=BALLASTED, search=search))
    assert found.profile.attrs["loading"] == "unloaded"
    loose = variant is Variant.LITERAL and objective is Objective.SIGNAL
    assert maximum_error(found.profile, truth) < (5e-4 if loose else 1e-6)


def test_the_same_seed_gives_identical_results(model_a: tuple[xr.Dataset, Array]) -> None:
    recording, _ = model_a
    first, again, other = (
        cross_entropy(recording, QUARTER_CAR, CrossEntropySettings(seed=seed))
        .profile["elevation"]
        .to_numpy()
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert np.any(first != other)


def test_affine_map_and_simulation_give_the_same_elite(model_b: tuple[xr.Dataset, Array]) -> None:
    short = model_b[0].isel(sample=slice(0, 32))
    search = replace(TABLE_6, population=40, threshold=1e-10)
    affine, simulated = (
        cross_entropy(
            short,
            VELARO,
            CrossEntropySettings(track=BALLASTED, search=search, evaluation=evaluation),
        )
        for evaluation in Evaluation
    )
    assert [len(one.runs) for one in affine.phases] == [len(one.runs) for one in simulated.phases]
    np.testing.assert_allclose(
        affine.profile["elevation"], simulated.profile["elevation"], rtol=0, atol=1e-9
    )


def window(sensors: int = 1, m: int = 6) -> tuple[Array, Array, Array]:
    """A triangular gain (sensors, m, m), the true elevations, and their signals."""
    generator = np.random.default_rng(4)
    gain = np.tril(generator.normal(0.0, 1.0, (sensors, m, m))) + 2.0 * np.eye(m)
    x = np.cumsum(generator.normal(0.0, 5e-4, m))
    return gain, x, gain @ x


SMALL = replace(TABLE_5, unknowns=6, length=None)


def search_window(search: SearchSettings, seed: int = 0) -> tuple[Array, SearchRun, Array]:
    gain, x, due = window()
    one = np.ones(1)
    start = np.diag(np.full(6, search.standard_deviation**2))
    generator = np.random.default_rng(seed)
    mean, run = optimise(
        lambda trials: kernels.misfits(gain, trials, due, one),
        np.zeros(6),
        start,
        search,
        generator,
    )
    return mean, run, x


@pytest.mark.parametrize("seed", range(5))
def test_a_long_run_converges_to_the_direct_solution(seed: int) -> None:
    mean, run, _ = search_window(replace(SMALL, threshold=1e-26), seed)
    gain, _, due = window()
    direct = np.linalg.solve(gain[0], due[0])
    assert run.converged
    np.testing.assert_allclose(mean, direct, rtol=0, atol=1e-11)


def test_a_lower_threshold_takes_more_generations_and_is_more_accurate() -> None:
    runs = [search_window(replace(SMALL, threshold=t)) for t in (1e-9, 1e-12, 1e-15, 1e-18)]
    lengths = [len(run.objective) for _, run, _ in runs]
    errors = [float(np.linalg.norm(mean - x)) for mean, _, x in runs]
    assert lengths == sorted(set(lengths))
    assert errors == sorted(errors, reverse=True)


def test_smoothing_takes_more_generations() -> None:
    lengths = [
        len(search_window(replace(SMALL, smoothing=s))[1].objective) for s in (0.3, 0.6, 0.8)
    ]
    assert lengths == sorted(set(lengths))


def test_a_larger_population_has_a_better_first_generation() -> None:
    best = [
        np.mean(
            [search_window(replace(SMALL, population=n), seed)[1].objective[0] for seed in range(9)]
        )
        for n in (30, 300, 3000)
    ]
    assert best == sorted(best, reverse=True)


def test_a_smaller_elite_converges_faster() -> None:
    lengths = [len(search_window(replace(SMALL, elite=e))[1].objective) for e in (0.1, 0.2, 0.4)]
    assert lengths == sorted(lengths)


def test_an_initial_mean_near_the_solution_has_a_smaller_objective() -> None:
    gain, x, due = window()
    misfits = lambda trials: kernels.misfits(gain, trials, due, np.ones(1))  # noqa: E731
    start = np.diag(np.full(6, SMALL.standard_deviation**2))
    first = [
        optimise(misfits, mean, start, SMALL, np.random.default_rng(0))[1].objective[0]
        for mean in (x, x + 5e-3)
    ]
    assert first[0] < 0.1 * first[1]


def test_fewer_unknowns_give_more_phases(model_a: tuple[xr.Dataset, Array]) -> None:
    recording, truth = model_a
    search = replace(TABLE_5, unknowns=6, length=None)
    found = cross_entropy(recording, QUARTER_CAR, CrossEntropySettings(search=search))
    assert {one.kept for one in found.phases[:-1]} == {3}
    assert maximum_error(found.profile, truth) < 1e-6


def test_a_larger_initial_deviation_takes_more_generations() -> None:
    lengths = [
        len(search_window(replace(SMALL, standard_deviation=s))[1].objective)
        for s in (1e-4, 1e-3, 1e-2)
    ]
    assert lengths == sorted(lengths)


def test_agreement_determines_the_number_of_runs() -> None:
    gain, _, due = window()
    misfits = lambda trials: kernels.misfits(gain, trials, due, np.ones(1))  # noqa: E731
    rough = replace(SMALL, threshold=1e-9, variant=Variant.LITERAL)

    def runs(agreement: float) -> int:
        search, generator = replace(rough, agreement=agreement), np.random.default_rng(0)
        return len(solve_phase(misfits, np.zeros(6), 0.0, search, generator, walk=True)[1])

    assert runs(10.0) == 2
    assert runs(1e-9) > 2


@pytest.mark.parametrize(
    ("variant", "equal"), [(Variant.LITERAL, False), (Variant.COVARIANCE, True)]
)
def test_only_the_covariance_variant_is_independent_of_the_level(
    variant: Variant, equal: bool
) -> None:
    """Elevations have no natural zero, but the paper's tolerance of 5 % of the elevation depends on it."""
    gain, _, due = window()
    search = replace(SMALL, threshold=1e-9, variant=variant, agreement=1e-3)

    def runs(level: float) -> int:
        raised = due + gain @ np.full(6, level)
        misfits = lambda trials: kernels.misfits(gain, trials, raised, np.ones(1))  # noqa: E731
        generator = np.random.default_rng(0)
        return len(solve_phase(misfits, np.full(6, level), level, search, generator, walk=True)[1])

    assert (runs(0.0) == runs(1.0)) is equal


def test_first_generation_is_a_random_walk() -> None:
    x = kernels.draw_random_walks(np.random.default_rng(0), 40_000, np.full(4, 1e-3), 2e-3)
    np.testing.assert_allclose(x.mean(axis=0), 1e-3, atol=1e-4)
    np.testing.assert_allclose(x.var(axis=0), 4e-6 * np.arange(1, 5), rtol=0.05)


def test_drawn_profiles_have_the_given_covariance() -> None:
    root = np.tril(np.random.default_rng(1).normal(0.0, 1e-3, (4, 4)))
    x = kernels.draw_normal(np.random.default_rng(0), 200_000, np.arange(4.0), root @ root.T)
    np.testing.assert_allclose(np.cov(x.T), root @ root.T, atol=0.02 * np.abs(root @ root.T).max())


def test_elites_are_the_best_by_the_whole_signal_or_by_each_scan() -> None:
    misfit = np.array([[0.0, 9.0], [5.0, 1.0], [2.0, 2.0], [6.0, 6.0]])
    np.testing.assert_array_equal(kernels.elite_by_total(misfit, 2), [[2, 1], [2, 1]])
    np.testing.assert_array_equal(kernels.elite_by_scan(misfit, 2), [[0, 2], [1, 2]])


@pytest.mark.parametrize("size", [1, 2, 10, 100])
def test_smallest_values_are_those_of_a_stable_sort(size: int) -> None:
    values = np.random.default_rng(size).integers(0, 30, 100).astype(np.float64)
    np.testing.assert_array_equal(
        kernels.smallest(values, size), np.argsort(values, kind="stable")[:size]
    )


def test_elite_moments_are_those_of_numpy() -> None:
    x = np.random.default_rng(2).normal(size=(20, 3))
    elite = np.tile(np.arange(5), (3, 1))
    np.testing.assert_allclose(kernels.elite_mean(x, elite), x[:5].mean(axis=0))
    np.testing.assert_allclose(kernels.elite_covariance(x, elite), np.cov(x[:5].T))
    np.testing.assert_allclose(
        kernels.elite_variances(x, elite), np.diag(x[:5].var(axis=0, ddof=1))
    )


def test_misfits_are_weighted_squares() -> None:
    gain, x, due = window(sensors=2)
    trials = np.vstack([x, x + 1e-3])
    expected = 0.2 * (trials @ gain[0].T - due[0]) ** 2 + 0.8 * (trials @ gain[1].T - due[1]) ** 2
    np.testing.assert_allclose(
        kernels.misfits(gain, trials, due, np.array([0.2, 0.8])), expected, atol=1e-18
    )


def test_sensor_weights_are_those_of_equation_12() -> None:
    signals = np.array([[3.0, 0.5], [-3.0, -0.5]])
    weight = sensor_weights(signals)
    assert weight[0] == pytest.approx(0.5 / 3.5)  # RMS_R / (RMS_A + RMS_R)
    assert weight.sum() == pytest.approx(1.0)


def test_phases_keep_half_and_cover_the_recording(model_a: tuple[xr.Dataset, Array]) -> None:
    found = cross_entropy(model_a[0], QUARTER_CAR)
    starts = [one.first for one in found.phases]
    assert starts == list(range(0, 5 * len(starts), 5))
    assert sum(one.kept for one in found.phases) == found.profile.sizes["distance"] == 160


def test_the_maximum_number_of_generations_flags_the_elevations(
    model_a: tuple[xr.Dataset, Array],
) -> None:
    search = replace(TABLE_5, generations=5, runs=2)
    found = cross_entropy(model_a[0], QUARTER_CAR, CrossEntropySettings(search=search))
    assert np.all((found.profile["quality"] & Quality.UNCONVERGED) != 0)
    assert any("did not converge" in note for note in found.notes)


def test_an_interrupt_returns_the_result_so_far(model_a: tuple[xr.Dataset, Array]) -> None:
    recording, _ = model_a

    def interrupt(stage: str, share: float) -> None:
        if share > 0.5:
            raise KeyboardInterrupt

    found = cross_entropy(recording, QUARTER_CAR, progress=interrupt)
    whole = cross_entropy(recording, QUARTER_CAR)
    count = found.profile.sizes["distance"]
    assert found.stopped == INTERRUPTED
    assert 80 <= count < 160
    np.testing.assert_array_equal(
        found.profile["elevation"], whole.profile["elevation"].isel(distance=slice(0, count))
    )
    assert any("ends at" in note for note in found.notes)


def test_longer_phases_use_every_other_sample(model_a: tuple[xr.Dataset, Array]) -> None:
    recording, truth = model_a
    found = cross_entropy(
        recording, QUARTER_CAR, CrossEntropySettings(search=replace(TABLE_5, length=0.5))
    )
    assert found.profile.sizes["distance"] == 80
    assert np.corrcoef(found.profile["elevation"], truth[1::2])[0, 1] > 0.99
    coarse = cross_entropy(
        recording, QUARTER_CAR, CrossEntropySettings(search=replace(TABLE_5, length=0.1))
    )
    assert any("instead of 0.1 m" in note for note in coarse.notes)


def test_a_stuck_channel_is_excluded_with_a_note(model_b: tuple[xr.Dataset, Array]) -> None:
    recording, truth = model_b
    dead = recording.copy(deep=True)
    dead["pitch"].values[:] = 0.0
    found = cross_entropy(dead, VELARO, CrossEntropySettings(track=BALLASTED))
    assert any(
        "'pitch' is not used: none of its samples is usable (stuck)" in note for note in found.notes
    )
    assert maximum_error(found.profile, truth) < 1e-6


class TestRejected:
    def test_population_too_small_for_an_elite(self) -> None:
        with pytest.raises(ModelError, match="population of at least 15"):
            replace(TABLE_6, population=10)

    @pytest.mark.parametrize(
        "wrong",
        [{"threshold": 0.0}, {"unknowns": 1}, {"elite": 1.5}, {"smoothing": 1.0}, {"length": 0.0},
         {"standard_deviation": float("nan")}, {"runs": 1}],
        ids=str,
    )  # fmt: skip
    def test_setting_out_of_range(self, wrong: dict[str, float]) -> None:
        with pytest.raises(ModelError, match=next(iter(wrong))):
            replace(TABLE_6, **wrong)  # pyright: ignore[reportArgumentType]

    def test_window_longer_than_the_recording(self, model_a: tuple[xr.Dataset, Array]) -> None:
        short = model_a[0].isel(sample=slice(0, 8))
        with pytest.raises(DataError, match="exceeds the recording"):
            cross_entropy(short, QUARTER_CAR)

    def test_missing_sample(self, model_a: tuple[xr.Dataset, Array]) -> None:
        broken = model_a[0].copy(deep=True)
        broken["acceleration_valid"] = ("sample", np.arange(161) != 40)
        parts = [
            Channel(
                "acceleration", broken["acceleration"].to_numpy(), VERTICAL_ACCELERATION, "bogie", 0.0,
                valid=np.arange(161) != 40,
            )
        ]  # fmt: skip
        recording = build_recording(parts, time=broken["time"], speed=broken["speed"])
        with pytest.raises(
            DataError, match=r"'acceleration' is invalid in data row 41 \(samples missing"
        ):
            cross_entropy(recording, QUARTER_CAR)

    def test_uneven_time(self, model_a: tuple[xr.Dataset, Array]) -> None:
        keep = np.flatnonzero(np.arange(161) != 50)
        with pytest.raises(DataError, match="evenly sampled"):
            cross_entropy(model_a[0].isel(sample=keep), QUARTER_CAR)

    def test_signal_of_zeros(self) -> None:
        with pytest.raises(DataError, match="zero throughout"):
            sensor_weights(np.array([[0.0, 1.0], [0.0, -1.0]]))

    def test_spike(self, model_a: tuple[xr.Dataset, Array]) -> None:
        spiked = model_a[0].copy(deep=True)
        spiked["acceleration"][100] = 50.0
        with pytest.raises(DataError, match=r"data row 101 \(spike\)"):
            cross_entropy(spiked, QUARTER_CAR)

    def test_sensor_that_does_not_react_to_the_leading_wheel(self) -> None:
        recording, _ = simulated(whole=True, length=25.0)
        parts = [
            Channel("far", recording["acceleration"].to_numpy(), VERTICAL_ACCELERATION, "trailing bogie", 0.0)
        ]  # fmt: skip
        moved = build_recording(
            parts, time=recording["time"], distance=recording["distance"], speed=recording["speed"]
        )
        with pytest.raises(DataError, match="No channel reacts"):
            cross_entropy(moved, VELARO)

    def test_missing_body(self, model_a: tuple[xr.Dataset, Array]) -> None:
        with pytest.raises(ModelError):
            cross_entropy(model_a[0], VELARO)
