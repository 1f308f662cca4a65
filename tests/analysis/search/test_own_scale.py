"""What may be said where a noise is known only in part: each condition by itself, at its edge."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from rigctl.analysis.agreement.adequacy import beyond_statement, error_below, white_at_floor, within_statement
from rigctl.analysis.search.own_scale import (
    doubts,
    not_a_sensor,
    proven_by_collapse,
    squares,
    times_the_floor,
)


def channel(name: str = "x", **changed: Any) -> Any:
    given = {
        "own_scale": True,
        "floor": 1.0,
        "allowed": 0.0,
        "together": 1.0,
        "over": 0.0,
        "plateau": True,
    }
    return SimpleNamespace(name=name, **(given | changed))


def fit(*channels: Any, rmse: float = 1.0, r2: float = 0.99, count: int = 200, **errors: float) -> Any:
    """A fit whose channels have these errors, SI."""
    noise = SimpleNamespace(channels=channels, spacing=0.5)
    found = {
        one.name: SimpleNamespace(rmse=errors.get(one.name, rmse), r2=r2, count=count, nrmse=rmse)
        for one in channels
    }
    return SimpleNamespace(problem=SimpleNamespace(noise=noise, shared=("a", "b")), errors=found)


# --- white at the floor


def white(rmse: float = 1.0, r2: float = 0.99, count: int = 20_000, found: Any = (), **noise: Any) -> bool:
    """Whether errors of this size count as white noise at a floor of 1."""
    tests = {"white_p": 0.5, "white_rms": math.nan, "white_degrees": 20_000} | dict(found)
    one = channel(**noise)
    return white_at_floor(fit(one, rmse=rmse, r2=r2, count=count), one, SimpleNamespace(**tests))  # type: ignore[arg-type]


def test_errors_are_white_at_the_floor_if_they_are_no_larger_and_show_no_pattern() -> None:
    assert white()
    assert white(0.5)
    assert white(1.08)  # the floor is known to 4 %
    assert not white(1.12)
    assert white(1.12, count=100)  # and fewer readings to less
    assert not white(1.3, count=100, found={"white_degrees": 20_000})
    assert white(1.3, count=100, found={"white_degrees": 10})
    assert not white(found={"white_p": 0.009})
    assert white(found={"white_p": 0.011})
    one = channel()
    assert not white_at_floor(fit(one), one, None)


def test_heavy_tails_raise_a_floor_by_a_limited_factor() -> None:
    assert white(1.3, found={"white_rms": 1.3})
    assert not white(1.6, found={"white_rms": 1.6})  # more than tails explain
    assert white(1.6, found={"white_rms": 1.6}, plateau=False)  # without a plateau the floor is a bound
    assert not white(1.0, found={"white_rms": 0.8}, plateau=False)
    assert white(1.0, found={"white_rms": 0.8})
    assert not white(0.0, floor=0.0)


def test_a_model_that_does_not_follow_a_moving_channel_is_no_noise() -> None:
    """Its errors are the floor's only if nothing moves: 1.0 of a channel that varies by 1.3."""
    assert white(1.0, r2=0.4)
    assert not white(1.0, r2=0.4, floor=0.4, found={"white_rms": 1.0}, plateau=False)
    assert white(1.0, r2=0.6, floor=0.4, found={"white_rms": 1.0}, plateau=False)
    assert white(1.0, r2=math.nan, floor=0.3, found={"white_rms": 1.0}, plateau=False)


# --- within what the rig file states


@pytest.mark.parametrize(
    ("errors", "noise", "why"),
    [
        ({"rmse": 1.0}, {"allowed": 1.0}, ""),
        ({"rmse": 0.1}, {"allowed": 1.0}, ""),
        ({"rmse": 1.05}, {"allowed": 1.0}, ""),  # 200 readings do not tell
        ({"rmse": 1.2}, {"allowed": 1.0}, "larger"),
        ({"rmse": 1.2}, {"allowed": 1.0, "together": 20.0}, ""),  # ten independent ones
        ({"rmse": 2.2, "r2": 0.4}, {"allowed": 5.0, "floor": 1.0}, ""),  # varies by 2.8 floors
        ({"rmse": 2.4, "r2": 0.4}, {"allowed": 5.0, "floor": 1.0}, "unexplained"),  # and by 3.1
        ({"rmse": 2.4, "r2": 0.6}, {"allowed": 5.0, "floor": 1.0}, ""),
        ({"rmse": 1.0}, {"allowed": 1.0, "over": 4.0}, ""),
        ({"rmse": 1.0}, {"allowed": 1.0, "over": 6.0}, "faster"),  # 0.5 s, less than a tenth
        ({"rmse": 1.0}, {"allowed": 1.0, "over": 6.0, "together": 2.0}, ""),
    ],
)
def test_errors_are_the_stated_noise_if_they_are_no_larger_and_no_faster(
    errors: Any, noise: Any, why: str
) -> None:
    one = channel(**noise)
    found = fit(one, **errors)
    assert beyond_statement(found, one) == why
    assert within_statement(found, one) is (why == "")
    one.allowed = 0.0
    assert within_statement(found, one) is False


def test_an_error_is_below_the_noise_only_if_that_of_every_channel_is() -> None:
    assert error_below(fit(channel(), rmse=0.9), 0.9)
    assert not error_below(fit(channel(), rmse=0.91), 0.9)


# --- an effect that proves itself


def collapsing(
    before: float = 10.0,
    after: float = 2.0,
    *,
    samples: int = 50,
    gain: float = 40.0,
    library: int = 12,
    stated: float = 0.0,
    effects: int = 1,
) -> bool:
    """Whether an effect proves itself that reduces the error of a channel from `before` to `after`."""
    one = channel(allowed=stated)
    search: Any = SimpleNamespace(
        before=SimpleNamespace(
            fit=fit(one, rmse=before), adequacy=SimpleNamespace(stated=("x",) if stated else ())
        ),
        null=SimpleNamespace(chi2=100.0),
        samples=samples,
        library=library,
    )
    best: Any = SimpleNamespace(
        candidates=(None,) * effects, fit=fit(one, rmse=after), parameters=effects, chi2=100.0 - gain
    )
    return proven_by_collapse(search, best)


def test_an_effect_proves_itself_by_a_collapse_that_chance_does_not_explain() -> None:
    assert collapsing()
    assert not collapsing(effects=0)
    assert not collapsing(before=0.0, after=0.0)
    assert collapsing(after=8.3)
    assert not collapsing(after=8.5)  # less than 30 % of the squares
    assert not collapsing(gain=0.0)
    assert not collapsing(gain=-40.0)
    assert collapsing(gain=13.5)
    assert not collapsing(gain=13.5, library=50)  # more effects were tried
    assert not collapsing(gain=13.5, samples=12)  # fewer independent readings
    assert not collapsing(gain=13.5, effects=2)
    assert not collapsing(gain=30.0, samples=1)


def test_a_stated_noise_is_refuted_by_an_error_of_less_than_half_of_it() -> None:
    assert not collapsing(stated=4.0)
    assert collapsing(stated=4.1)


def test_only_channels_of_which_nothing_but_the_floor_is_known_count() -> None:
    known, bare = channel("known", own_scale=False), channel("bare", floor=0.0)
    one, other = channel("one", floor=2.0), channel("other")
    found = fit(known, bare, one, other, one=6.0, other=4.0, known=99.0, bare=99.0)
    assert squares(found) == 9.0 + 16.0
    assert times_the_floor(found) == 4.0
    del found.errors["other"]
    assert squares(found) == 9.0
    assert times_the_floor(found) == 3.0
    assert times_the_floor(fit(known)) == 0.0


@pytest.mark.parametrize(
    ("before", "after", "doubted"),
    [(6.0, 3.1, True), (6.0, 2.9, False), (11.0, 3.4, False), (9.0, 3.1, True)],
)
def test_what_leaves_more_than_slow_noise_may_be_only_the_nearest(
    before: float, after: float, doubted: bool
) -> None:
    search: Any = SimpleNamespace(before=SimpleNamespace(fit=fit(channel(), rmse=before)))
    best: Any = SimpleNamespace(fit=fit(channel(), rmse=after))
    assert bool(doubts(search, best)) is doubted


@pytest.mark.parametrize(
    ("name", "size", "floor", "told"),
    [
        ("lag_of_x", 1100.0, 1.0, True),
        ("lag_of_x", -1100.0, 1.0, True),
        ("lag_of_x", 1000.0, 1.0, False),
        ("lag_of_x", 1100.0, 0.0, False),
        ("lag_of_y", 1100.0, 1.0, False),
    ],
)
def test_an_error_of_a_thousand_times_the_noise_is_no_sensors(
    name: str, size: float, floor: float, told: bool
) -> None:
    """The size is counted from where the effect is off, here 100."""
    candidate = SimpleNamespace(
        name=name, columns=(f"{name}.size",), parameter=lambda column: SimpleNamespace(at_null=100.0)
    )
    best: Any = SimpleNamespace(
        fit=fit(channel(floor=floor)), candidates=(candidate,), value=lambda column: (100.0 + size, 0.0)
    )
    assert bool(not_a_sensor(best)) is told
    candidate.columns = ("other",)
    assert not not_a_sensor(best)
