"""Frequency responses beside closed forms, beside SciPy's spectra, and with known noise."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import signal

from rigctl.frequency.multisine import low_crest_phases
from rigctl.frequency.periods import find_periods
from rigctl.frequency.response import Spectrum, estimate
from rigctl.frequency.signals import Held, Signals

Floats = NDArray[np.float64]

LAG, DELAY, GAIN = 0.8, 0.13, 2.5
NATURAL, DAMPING = 2.0 * np.pi * 0.9, 0.15


def lag_with_dead_time(since: Floats) -> Floats:
    """The step response of ``GAIN e^{-s DELAY}/(1 + s LAG)``."""
    late = np.maximum(since - DELAY, 0.0)
    return GAIN * (1.0 - np.exp(-late / LAG))


def resonance(since: Floats) -> Floats:
    """The step response of ``1/(1 + 2 DAMPING s/NATURAL + (s/NATURAL)^2)``."""
    time = np.maximum(since, 0.0)
    damped = NATURAL * np.sqrt(1.0 - DAMPING**2)
    envelope = np.exp(-DAMPING * NATURAL * time)
    return 1.0 - envelope * (np.cos(damped * time) + DAMPING * NATURAL / damped * np.sin(damped * time))


RESPONSES = {
    "lag": (
        lag_with_dead_time,
        lambda f: GAIN * np.exp(-2j * np.pi * f * DELAY) / (1.0 + 2j * np.pi * f * LAG),
    ),
    "resonance": (
        resonance,
        lambda f: signal.freqs([1.0], [1.0 / NATURAL**2, 2.0 * DAMPING / NATURAL, 1.0], 2.0 * np.pi * f)[1],
    ),
}


def answer_to(command: Held, step_response: object, times: Floats) -> Floats:
    """The exact output: a step response for every change of the command, which was 0 before."""
    changes = np.diff(command.values, prepend=0.0)
    assert callable(step_response)
    return sum(
        (
            change * step_response(times - at)
            for at, change in zip(command.times, changes, strict=True)
            if change
        ),
        np.zeros(times.size),
    )


def multisine(harmonics: range, period: float, rate: float, periods: int) -> Held:
    phases = low_crest_phases(harmonics).values
    count = round(period * rate)
    angle = 2.0 * np.pi * np.arange(count) / count
    once = sum(np.cos(order * angle + phase) for order, phase in zip(harmonics, phases, strict=True))
    return Held(np.arange(count * periods) / rate, np.tile(np.asarray(once), periods))


def telegraph(seed: int, end: float, hold: float = 0.1) -> Held:
    """A command that is one of two levels, drawn anew every `hold` s."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, end, hold)
    return Held(times, rng.integers(0, 2, times.size) * 2.0 - 1.0)


@pytest.mark.parametrize("name", RESPONSES)
def test_lines_of_whole_periods_are_those_of_the_closed_form(name: str) -> None:
    """Sampling shares no multiple with the period, its times scatter, and some samples are missing."""
    step_response, closed_form = RESPONSES[name]
    command = multisine(range(1, 31), 10.0, 20.0, 4)
    rng = np.random.default_rng(1)
    times = np.sort(np.arange(0.0, 40.0, 0.0307) + rng.uniform(-2e-3, 2e-3, 1303))
    output = answer_to(command, step_response, times)
    output[rng.integers(0, times.size, 20)] = np.nan
    found = estimate([Signals(times, (command,), output[:, None])])
    assert found is not None
    assert [(one.settling, len(one.starts)) for one in found.periods] == [(1, 3)]
    assert found.periods[0].length == pytest.approx(10.0, abs=1e-6)
    band = found.frequencies < 3.05
    assert found.frequencies[band] == pytest.approx(np.arange(1, 31) / 10.0)
    assert found.excited[band].all()
    error = found.responses[0].gain[band] / closed_form(found.frequencies[band]) - 1.0
    assert np.abs(error).max() < 5e-3
    assert found.responses[0].coherence[band].min() > 0.9999


@pytest.mark.parametrize("name", RESPONSES)
def test_windows_of_a_random_command_come_near_the_closed_form(name: str) -> None:
    """The phase is that of the command itself, not of its value at the samples, which would be late."""
    step_response, closed_form = RESPONSES[name]
    times = np.arange(0.0, 600.0, 0.05)
    command = telegraph(1, 600.0, 0.13)
    found = estimate([Signals(times, (command,), answer_to(command, step_response, times)[:, None])])
    assert found is not None and not found.periods
    band = found.excited & (found.frequencies < 3.0)
    assert band.sum() > 50
    ratio = found.responses[0].gain[band] / closed_form(found.frequencies[band])
    assert np.median(np.abs(ratio)) == pytest.approx(1.0, abs=0.01)
    assert np.median(np.angle(ratio)) == pytest.approx(0.0, abs=0.01)
    # what is off is what the circles say: leakage near the resonance
    inside = (
        np.abs(ratio - 1.0) * np.abs(closed_form(found.frequencies[band]))
        < 2.0 * found.responses[0].radius[band]
    )
    assert inside.mean() > 0.9


@pytest.mark.parametrize("periodic", [True, False])
def test_what_an_earlier_estimate_knows_of_the_command_changes_nothing(*, periodic: bool) -> None:
    command = multisine(range(1, 31), 10.0, 20.0, 4) if periodic else telegraph(1, 40.0, 0.13)
    times = np.arange(0.0, 40.0, 0.05)
    first, other = (
        Signals(times, (command,), answer_to(command, RESPONSES[name][0], times)[:, None])
        for name in RESPONSES
    )
    earlier, found = estimate([first]), estimate([other])
    assert earlier is not None and found is not None and bool(found.periods) is periodic
    again = estimate([other], like=earlier)
    assert again is not None and again.periods == found.periods
    for name in ("frequencies", "excited", "input_rms", "images"):
        np.testing.assert_array_equal(getattr(again, name), getattr(found, name))
    np.testing.assert_array_equal(again.responses[0].gain, found.responses[0].gain)


def test_h1_and_coherence_are_those_of_scipy() -> None:
    rng = np.random.default_rng(3)
    u = rng.standard_normal(6000)
    y = signal.lfilter([0.2], [1.0, -0.8], u) + rng.standard_normal(6000)
    times = 0.01 * np.arange(6000)
    found = estimate([Signals(times, (u,), y[:, None])], resolution=100.0 / 256)
    assert found is not None
    settings = {"fs": 100.0, "window": "hann", "nperseg": 256, "noverlap": 128, "detrend": "linear"}
    frequencies, cross = signal.csd(u, y, **settings)
    _, power = signal.welch(u, **settings)
    _, coherence = signal.coherence(u, y, **settings)
    at = np.round(found.frequencies / frequencies[1]).astype(int)
    assert found.frequencies == pytest.approx(frequencies[at])
    assert found.responses[0].gain == pytest.approx(cross[at] / power[at], rel=1e-9)
    assert found.responses[0].coherence == pytest.approx(coherence[at], rel=1e-9)


@pytest.mark.parametrize("ratio", [0.25, 1.0, 9.0])
def test_coherence_is_the_share_of_the_signal(ratio: float) -> None:
    """White input and white noise: ``gamma^2 = ratio/(1 + ratio)`` at every line."""
    rng = np.random.default_rng(4)
    u = rng.standard_normal(200_000)
    y = np.sqrt(ratio) * u + rng.standard_normal(u.size)
    found = estimate([Signals(np.arange(u.size) * 1.0, (u,), y[:, None])])
    assert found is not None and found.averages > 150
    assert found.responses[0].coherence.mean() == pytest.approx(ratio / (1.0 + ratio), abs=0.01)


def noisy_lines(seed: int) -> Spectrum:
    rng = np.random.default_rng(seed)
    command = multisine(range(1, 26), 10.0, 20.0, 6)
    times = np.arange(0.0, 60.0, 0.05)
    clean = answer_to(command, lag_with_dead_time, times)
    nothing = rng.standard_normal(times.size)
    found = estimate([Signals(times, (command,), np.column_stack([clean + 2.0 * nothing, nothing]))])
    assert found is not None
    return found


def test_the_circles_hold_the_truth_as_often_as_they_say() -> None:
    inside, chance = [], []
    for seed in range(12):
        found = noisy_lines(seed)
        band = found.frequencies < 2.55
        truth = RESPONSES["lag"][1](found.frequencies[band])
        inside += (np.abs(found.responses[0].gain[band] - truth) < found.responses[0].radius[band]).tolist()
        chance += (found.responses[1].p_value[band] < 0.05).tolist()
    assert 0.92 < np.mean(inside) < 0.98  # of 300: 0.95 ± 0.025
    assert 0.025 < np.mean(chance) < 0.08


def test_windows_of_noise_show_a_response_as_rarely_as_they_say() -> None:
    rng = np.random.default_rng(5)
    shares = []
    for _ in range(20):
        u, y = rng.standard_normal((2, 4000))
        found = estimate([Signals(np.arange(4000) * 0.1, (u,), y[:, None])])
        assert found is not None
        shares.append(np.mean(found.responses[0].p_value < 0.05))
        assert np.mean(found.responses[0].coherence > found.least_coherence) < 0.05
    assert np.mean(shares) == pytest.approx(0.05, abs=0.015)


def test_another_input_that_moves_along_is_not_taken_for_this_one() -> None:
    rng = np.random.default_rng(6)
    other = rng.standard_normal(20_000)
    u = 0.7 * other + rng.standard_normal(other.size)
    y = 2.0 * u - 5.0 * other + 0.1 * rng.standard_normal(other.size)
    signals = Signals(np.arange(other.size) * 0.1, (u, other), y[:, None])
    both, alone = estimate([signals]), estimate([replace(signals, inputs=(u,))])
    assert both is not None and alone is not None
    assert np.abs(both.responses[0].gain - 2.0).max() < 0.15
    assert both.responses[0].coherence.min() > 0.98
    assert np.median(np.abs(alone.responses[0].gain - 2.0)) > 1.0
    # nothing can be said of one that only follows the other
    follows = estimate([replace(signals, inputs=(0.5 * other, other))])
    assert follows is not None and not follows.excited.any()


def test_lines_without_power_are_not_excited() -> None:
    rng = np.random.default_rng(7)
    sos = signal.cheby2(12, 80, 0.2, output="sos")
    u = signal.sosfilt(sos, rng.standard_normal(20_000))
    found = estimate(
        [Signals(np.arange(u.size) * 0.1, (u,), u[:, None] + 1e-3 * rng.standard_normal((u.size, 1)))]
    )
    assert found is not None
    assert found.excited[found.frequencies < 0.8].all()
    assert not found.excited[found.frequencies > 1.2].any()
    assert np.isnan(found.responses[0].gain[~found.excited]).all()
    assert np.isinf(found.responses[0].radius[~found.excited]).all()


@given(
    st.integers(0, 10_000),
    st.integers(6, 40),
    st.integers(2, 6),
    st.floats(0.0, 8.0),
    st.floats(0.011, 0.04),
)
def test_a_period_is_found_whatever_the_record_holds_before(
    seed: int, steps: int, periods: int, before: float, interval: float
) -> None:
    rng = np.random.default_rng(seed)
    hold = 0.3
    levels = rng.choice([-2.0, -1.0, 1.0, 3.0], steps)
    levels[: steps // 2] += 0.5  # no shorter period
    values = np.concatenate(([0.0], np.tile(levels, periods)))
    times = np.concatenate(([0.0], before + 0.5 + hold * np.arange(steps * periods)))
    end = before + 0.5 + hold * steps * periods
    samples = np.arange(0.0, end, interval)
    found = find_periods(Signals(samples, (Held(times, values),), np.zeros((samples.size, 1))))
    if steps * periods * hold < 0.55 * end:
        return  # too little of the record
    assert found is not None
    assert found.length == pytest.approx(hold * steps, rel=1e-6)
    assert len(found.starts) + found.settling == periods


@given(st.integers(0, 10_000))
def test_a_random_command_has_no_period(seed: int) -> None:
    times = np.arange(0.0, 60.0, 0.05)
    assert find_periods(Signals(times, (telegraph(seed, 60.0, 0.5),), np.zeros((times.size, 1)))) is None


def test_a_single_step_has_no_period() -> None:
    times = np.arange(0.0, 60.0, 0.05)
    for at in (1.0, 20.0, 55.0):
        step = Held(np.array([0.0, at]), np.array([0.0, 1.0]))
        assert find_periods(Signals(times, (step,), np.zeros((times.size, 1)))) is None


def test_a_record_that_is_too_short_has_no_response() -> None:
    times = np.arange(0.0, 1.0, 0.05)
    assert estimate([Signals(times, (telegraph(1, 1.0),), np.zeros((times.size, 1)))]) is None


@pytest.mark.parametrize("periodic", [False, True], ids=["windows", "periods"])
@pytest.mark.parametrize("kind", ["lag", "resonance", "none"])
def test_lines_that_are_sound_are_those_of_a_plant_driven_by_one_command_per_sample(
    kind: str, periodic: bool
) -> None:
    """The command's images at the sampling rate fold onto each line, and always in the same way."""
    step, rate = 0.1, 2.0 * np.pi
    system = {
        "lag": ([1.0], [0.7, 1.0]),
        "resonance": ([rate**2], [1.0, 0.2 * rate, rate**2]),
        "none": ([1.0], [1.0]),
    }[kind]
    rng = np.random.default_rng(0)
    values = np.tile(rng.standard_normal(400), 6) if periodic else rng.standard_normal(20_000)
    times = step * np.arange(values.size)
    above, below, _ = signal.cont2discrete(system, step)
    output = signal.lfilter(np.ravel(above), below, values)
    found = estimate([Signals(times, (Held(times, values),), output[:, None])])
    assert found is not None and bool(found.periods) == periodic
    folded = found.folded(found.responses[0])
    sound = found.excited & ~folded
    truth = signal.freqs(*system, 2.0 * np.pi * found.frequencies[sound])[1]
    assert np.abs(np.abs(found.responses[0].gain[sound] / truth) - 1.0).max() < 0.03
    assert folded[found.excited & (found.frequencies > 3.0)].all()
    assert not folded[found.excited & (found.frequencies < 0.08 / step)].any()
    # a response that falls steeply answers little beyond: its resonance at 1 Hz is not hidden
    assert sound[np.argmin(np.abs(found.frequencies - 1.0))] == (kind == "resonance")


def test_of_two_interleaved_multisines_each_excites_its_own_lines() -> None:
    times = np.arange(0.0, 50.0, 0.05)
    one, other = multisine(range(1, 40, 2), 10.0, 20.0, 5), multisine(range(2, 41, 2), 10.0, 20.0, 5)
    output = answer_to(one, lag_with_dead_time, times) - 3.0 * answer_to(other, resonance, times)
    for inputs, first in (((one, other), 1), ((other, one), 2)):
        found = estimate([Signals(times, inputs, output[:, None])])
        assert found is not None
        excited = np.round(10.0 * found.frequencies[found.excited])
        assert excited[:20].tolist() == list(range(first, 41, 2))
        truth = RESPONSES["lag"][1] if first == 1 else lambda f: -3.0 * RESPONSES["resonance"][1](f)
        at = np.flatnonzero(found.excited)[:12]
        gain = found.responses[0].gain[at]
        assert gain == pytest.approx(truth(found.frequencies[at]), rel=0.03)


def test_the_least_coherence_holds_with_other_inputs_too() -> None:
    rng = np.random.default_rng(11)
    above = []
    for _ in range(40):
        u, v, w, y = rng.standard_normal((4, 4000))
        found = estimate([Signals(np.arange(4000) * 0.1, (u, v, w), y[:, None])])
        assert found is not None and found.inputs == 3
        above.append(np.mean(found.responses[0].coherence[found.excited] > found.least_coherence))
    assert 0.004 < np.mean(above) < 0.016


def test_a_drift_over_the_periods_is_no_response() -> None:
    """Even where most lines are fitted, which leave little to tell a straight line by."""
    rng = np.random.default_rng(12)
    values = np.tile(rng.standard_normal(400), 6)
    times = 0.1 * np.arange(values.size)
    lag = signal.lfilter([0.0, 0.2], [1.0, -0.8], values)
    plain, drifting = (
        estimate([Signals(times, (Held(times, values),), (lag + drift)[:, None])])
        for drift in (0.0, 0.05 * times)
    )
    assert plain is not None and drifting is not None and plain.left_out > 0
    assert drifting.responses[0].gain == pytest.approx(plain.responses[0].gain, rel=1e-3)


def test_a_record_that_is_mostly_gaps_has_no_periods() -> None:
    """Pairs of samples 1 ns apart would otherwise be sought in 1e10 steps."""
    times = (np.arange(0.0, 10.0, 0.05)[:, None] + [0.0, 1e-9]).ravel()
    assert find_periods(Signals(times, (telegraph(1, 10.0),), np.zeros((times.size, 1)))) is None


def test_long_periods_take_no_more_than_pieces_of_memory() -> None:
    tracemalloc.start()
    values = np.tile(np.random.default_rng(13).standard_normal(1000), 3)
    times = 0.001 * np.arange(300_000)
    command = Held(0.1 * np.arange(values.size), values)
    output = signal.lfilter([1e-3], [1.0, -0.999], command.means(times + 5e-4, 1e-3))
    found = estimate([Signals(times, (command,), output[:, None])])
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found is not None and len(found.periods[0].starts) == 2
    assert found.frequencies.size == 400 and found.left_out > 100
    assert most < 250e6
