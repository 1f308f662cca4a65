"""The board's closed loop: its arithmetic and the host's against one simulation, its ends, its timing."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from rigctl.backends.emulated.avr import FREQUENCY
from rigctl.steps.control.pid import AntiWindup, Bounds, Gains, Pid

if TYPE_CHECKING:
    from board_chip import Chip

#: the defaults of `CONT:PAR` in these tests: counts in, counts out
PLAIN: dict[str, float] = {
    "C0": 0.0,
    "C1": 1.0,
    "C2": 0.0,
    "C3": 0.0,
    "RLO": 0.0,
    "RHI": 1023.0,
    "ZERO": 0.0,
    "FULL": 1023.0,
    "TO": 400.0,
    "RAMP": math.inf,
    "FF": 0.0,
    "KP": 1.0,
    "KI": 4.0,
    "KD": 0.0,
    "TF": 0.0,
    "TT": 0.25,
    "LOW": 0.0,
    "HIGH": 900.0,
    "RATE": math.inf,
}
PERIOD = 0.01


def tell(chip: Chip, period_ms: int = 10, **settings: float) -> None:
    """Give the board the settings of a loop."""
    lines = ["CONT:CLE", "CONT:INP 0", f"CONT:PER {period_ms}"]
    lines += [f"CONT:PAR {name},{value:.9g}" for name, value in {**PLAIN, **settings}.items()]
    for line in lines:
        assert chip.send(f"#1 {line}", 0.008) == ["#1 OK"]


def begin(chip: Chip, how: str = "BUMP", **settings: float) -> None:
    tell(chip, **settings)
    assert chip.send(f"#1 CONT:STAR {how}", 0.008) == ["#1 OK"]


def figures(chip: Chip) -> list[int]:
    return [int(part) for part in chip.ask("CONT:FIG?").split(",")]


# --- the same arithmetic ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """A loop around a first-order lag, in counts."""

    settings: dict[str, float]
    clamping: bool = False
    bumpless: bool = True
    lag: float = 0.15
    begin: float = 100.0  # the first reading
    count: int = 120


CASES = {
    "saturated, led back": Case({"KP": 3.0, "KI": 15.0, "TT": 0.2, "HIGH": 500.0}),
    "saturated, clamped": Case({"KP": 3.0, "KI": 15.0, "HIGH": 500.0}, clamping=True, bumpless=False),
    "derivative, rate, ramp, feed-forward": Case(
        {"KP": 0.5, "KI": 3.0, "KD": 0.02, "TF": 0.03, "RATE": 900.0, "RAMP": 600.0, "FF": 60.0}
    ),
    "downwards, no integral": Case(
        {"KP": 2.0, "KI": 0.0, "TT": math.inf, "TO": 150.0, "RAMP": 300.0}, begin=600.0
    ),
    "a curved calibration, a falling output": Case(
        {"C0": 5.0, "C1": 0.8, "C2": 2e-4, "C3": 5e-8, "RHI": 2000.0, "ZERO": 1023.0, "FULL": 0.0, "KP": -1.0,
         "KI": -5.0, "HIGH": 1000.0}
    ),
}  # fmt: skip


def simulated(case: Case) -> tuple[list[int], list[float], list[int]]:
    """Readings in counts, outputs and outputs in counts, by a simulation that shares no code with any."""
    s = {**PLAIN, **case.settings}
    level, pwm = case.begin, 0
    readings: list[int] = []
    outputs: list[float] = []
    sent: list[int] = []
    values: list[float] = []
    integral, slope, out = 0.0, 0.0, s["ZERO"]
    for k in range(case.count):
        readings.append(min(max(round(level), 0), 1023))
        n = readings[-1]
        values.append(sum(s[f"C{i}"] * n**i for i in range(4)))
        distance = s["TO"] - values[0]
        gone = min(s["RAMP"] * k * PERIOD, abs(distance)) if k or math.isfinite(s["RAMP"]) else abs(distance)
        error = values[0] + math.copysign(gone, distance) - values[-1]
        if k == 0 and case.bumpless and s["KI"]:
            integral = out - s["KP"] * error - s["FF"]
        if k and s["KD"]:
            slope = (s["TF"] * slope - s["KD"] * (values[-1] - values[-2])) / (s["TF"] + PERIOD)
        wanted = s["FF"] + s["KP"] * error + integral + slope
        step = s["RATE"] * PERIOD if k else (0.0 if math.isfinite(s["RATE"]) else math.inf)
        new = min(max(min(max(wanted, out - step), out + step), s["LOW"]), s["HIGH"])
        bounded, out = new != wanted, new
        if k:
            rise = s["KI"] * error * PERIOD
            if case.clamping:
                integral += 0.0 if bounded and rise * (out - wanted) < 0.0 else rise
            else:
                integral += rise + ((out - wanted) * PERIOD / s["TT"] if bounded and s["KI"] else 0.0)
        pwm = round((out - s["ZERO"]) / (s["FULL"] - s["ZERO"]) * 1023)
        outputs.append(out)
        sent.append(pwm)
        level = pwm + (level - pwm) * math.exp(-PERIOD / case.lag)
    return readings, outputs, sent


@pytest.mark.parametrize("name", CASES)
def test_board_and_host_agree_with_an_independent_simulation(chip: Chip, name: str) -> None:
    case = CASES[name]
    readings, expected, sent = simulated(case)
    assert len(set(sent)) > 20, "a loop in which something happens"

    s = {**PLAIN, **case.settings}
    wind_up = AntiWindup.CLAMPING if case.clamping else AntiWindup.BACK_CALCULATION
    host = Pid(
        Gains(s["KP"], s["KI"], s["KD"], s["TF"], s["TT"], wind_up),
        Bounds(s["LOW"], s["HIGH"], s["RATE"]),
        s["ZERO"],
        bumpless=case.bumpless,
    )
    of_host, first = [], None
    for k, counts in enumerate(readings):
        value = sum(s[f"C{i}"] * counts**i for i in range(4))
        first = value if first is None else first
        distance = s["TO"] - first
        gone = min(s["RAMP"] * k * PERIOD, abs(distance)) if math.isfinite(s["RAMP"]) else abs(distance)
        of_host.append(host.update(k * PERIOD, value, first + math.copysign(gone, distance), s["FF"]))
    assert of_host == pytest.approx(expected, abs=1e-9)

    tell(chip, **case.settings)
    chip.put(readings[0], 500, 300)
    how = ("BUMP" if case.bumpless else "ZERO") + (",CLAM" if case.clamping else "")
    assert chip.send(f"#1 CONT:STAR {how}", 0.008) == ["#1 OK"]  # the first update is made by then
    of_board = [round(chip.avr.pwm * 1023)]
    for k, counts in enumerate(readings[1:]):
        chip.put(counts, 500, 300)
        chip.run(PERIOD)
        of_board.append(round(chip.avr.pwm * 1023))
        if k % 100 == 99:
            chip.tell("SYST:PING")
    assert max(abs(a - b) for a, b in zip(of_board, sent, strict=True)) <= 1
    assert figures(chip)[0] >= case.count


def test_a_slow_integral_is_not_lost_to_24_bit_rounding(chip: Chip) -> None:
    begin(chip, period_ms=1, KP=0.0, KI=1e-4, C0=399.0, C1=0.0, FF=800.0, HIGH=1000.0)
    for _ in range(4):
        chip.send("SYST:PING", 1.0)
    running, _, _, output = chip.ask("CONT?").split(",")
    updates = figures(chip)[0]
    step = (
        800.0 * 2.0**-24
    )  # of the integral, which begins at -800: each update adds less than a hundredth of it
    assert running == "1"
    assert float(output) == pytest.approx(1e-4 * 1e-3 * updates, abs=1.5 * step)
    assert float(output) > 6.0 * step


@pytest.mark.parametrize("wind_up", ["", ",CLAM"])
def test_overflowing_values_command_only_values_at_the_limits(chip: Chip, wind_up: str) -> None:
    chip.put(399, 500, 300)
    begin(chip, f"BUMP{wind_up}", period_ms=1, KP=3e38, KI=3e38, KD=3e38, TF=0.01, LOW=100.0)
    for counts in (300, 500, 350, 450):
        chip.put(counts, 500, 300)
        chip.run(0.02)
        assert round(chip.avr.pwm * 1023) in (0, 100, 900)
    assert "NAN" not in chip.ask("CONT?")


# --- ends of a loop -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("end", "pwm"),
    [
        ("CONT:STOP", None),
        ("OUTP:SAFE", 0),
        ("*RST", 0),
        ("SOUR:PRES 77", 77),
        ("CONT:CLE", None),
        ("DIAG:HANG", 0),
    ],
)
def test_every_way_of_ending_a_loop_leaves_the_output_unchanged_afterwards(
    chip: Chip, end: str, pwm: int | None
) -> None:
    begin(chip, KI=1.0)
    chip.run(0.1)
    assert chip.ask("CONT?").startswith("1,")
    assert chip.avr.pwm > 0.0
    chip.send(end, 0.3 if end == "DIAG:HANG" else 0.03)
    left = chip.avr.pwm
    assert left * 1023 == pytest.approx(pwm) if pwm is not None else left > 0.0
    chip.run(0.2)
    assert chip.avr.pwm == left
    assert chip.ask("CONT?").startswith("0,")


@pytest.mark.parametrize(
    ("counts", "cause"),
    [
        ((680, 500, 300), "over-pressure"),
        ((200, 500, 640), "over-temperature"),
        ((0, 500, 300), "sensor open"),
    ],
)
def test_the_boards_interlocks_end_a_loop(chip: Chip, counts: tuple[int, int, int], cause: str) -> None:
    begin(chip)
    chip.run(0.05)
    chip.put(*counts)
    chip.run(0.006)
    assert chip.avr.pwm == 0.0
    assert cause in chip.ask("SYST:TRIP?")
    chip.put(200, 500, 300)
    assert "-221" in chip.ask("#1 CONT:STAR BUMP"), "latched"
    chip.run(0.05)
    assert chip.avr.pwm == 0.0


def test_a_trip_at_any_time_of_an_update_leaves_the_output_off(chip: Chip) -> None:
    for phase in range(0, 1000, 90):
        begin(chip, period_ms=1, KD=0.01, TF=0.01)
        chip.run(0.01 + phase * 1e-6)
        chip.put(1023, 500, 300)
        chip.run(0.004)
        assert chip.avr.pwm == 0.0
        chip.put(200, 500, 300)
        chip.run(0.008)  # until its cause is gone: good readings cancel the faulty ones
        assert chip.avr.pwm == 0.0
        assert chip.ask("#1 SYST:TRIP:CLE") == "#1 OK"


def test_a_trip_while_a_loop_starts_leaves_no_loop_running(chip: Chip) -> None:
    """A loop running with a latched trip would drive the output as soon as the trip is cleared."""
    tell(chip)
    for phase in range(0, 600, 20):
        chip.put(1000, 500, 300)
        chip.run(phase * 1e-6)
        chip.send("CONT:STAR BUMP", 0.008)
        chip.put(200, 500, 300)
        chip.run(0.003)
        assert chip.ask("CONT?").startswith("0,")
        assert chip.ask("#1 SYST:TRIP:CLE") == "#1 OK"
        chip.run(0.03)
        assert chip.avr.pwm == 0.0


def test_a_silent_host_ends_a_loop_even_while_its_output_is_off(chip: Chip) -> None:
    chip.put(600, 500, 300)  # above the set-point: the output rests at its low end
    begin(chip)
    chip.run(1.6)
    assert chip.ask("SYST:TRIP?") == '4,"host silent"'
    chip.put(200, 500, 300)
    chip.run(0.1)
    assert chip.avr.pwm == 0.0


def test_an_impossible_reading_holds_the_output(chip: Chip) -> None:
    begin(chip, RHI=500.0)
    chip.run(0.1)
    chip.put(600, 500, 300)
    chip.run(0.02)
    held = chip.avr.pwm
    chip.run(0.2)
    assert chip.avr.pwm == held > 0.0
    assert figures(chip)[2] == pytest.approx(22, abs=2)


def test_a_loop_with_missing_or_invalid_settings_is_refused(chip: Chip) -> None:
    for line in ("CONT:CLE", "CONT:INP 0", "CONT:PER 10"):
        assert chip.send(f"#1 {line}", 0.008) == ["#1 OK"]
    assert "-221" in chip.ask("#1 CONT:STAR BUMP"), "settings are missing"
    for wrong in ({"LOW": 10.0, "HIGH": 5.0}, {"FULL": 0.0}, {"KI": 1.0, "TT": 0.0}, {"KD": 1.0, "TF": 0.0}):
        tell(chip, **wrong)
        assert "-221" in chip.ask("#1 CONT:STAR BUMP")
    for line, error in (
        ("CONT:PAR KX,1", -104),
        ("CONT:PAR KP,NAN", -104),
        ("CONT:PAR KP,1X", -104),
        ("CONT:PAR KP,INF", -222),
        ("CONT:PAR KP", -109),
        ("CONT:INP 3", -222),
        ("CONT:PER 0", -222),
        ("CONT:PER 60001", -222),
        ("CONT:STAR", -109),
        ("CONT:STAR SOON", -104),
        ("CONT:STAR BUMP,SOON", -104),
    ):
        assert f"!{error}," in chip.ask(f"#1 {line}"), line
    assert chip.avr.pwm == 0.0


def test_a_running_loop_accepts_a_new_set_point_and_refuses_new_gains(chip: Chip) -> None:
    begin(chip, KP=0.0, KI=0.0, TT=math.inf, FF=100.0)
    assert chip.ask("#1 CONT:STAR BUMP") == "#1 OK", "asked twice, as its answer may have been lost"
    assert round(chip.avr.pwm * 1023) == 100
    assert chip.ask("#1 CONT:PAR FF,250") == "#1 OK"
    assert chip.ask("#1 CONT:PAR TO,300") == "#1 OK"
    for refused in ("CONT:PAR KP,1", "CONT:INP 1", "CONT:PER 5"):
        assert "-221" in chip.ask(f"#1 {refused}")
    running, pwm, setpoint, output = chip.ask("CONT?").split(",")
    assert (running, pwm, float(setpoint), float(output)) == ("1", "250", 300.0, 250.0)


# --- timing -------------------------------------------------------------------------------------------------


def test_the_loop_jitter_is_below_0_03_ms_and_reported_on_a_busy_line(chip: Chip) -> None:
    """Compared with the cycles at which the PWM register was actually written."""
    written: list[int] = []
    chip.avr.on_pwm(written.append)
    chip.put(310, 500, 300)
    begin(chip, KP=4.0, KI=0.0, TT=math.inf, KD=0.01, TF=0.01)
    chip.tell("STRM 200")
    for k in range(200):
        chip.put(200 + 7 * (k % 23), 500, 300)  # so that every update writes another output
        chip.tell("#8 CONT:FIG?" if k == 199 else "#7 MEAS:ALL?" if k % 10 == 0 else "")
        chip.run(PERIOD)
    (told,) = (line for line in chip.avr.take().decode().splitlines() if line.startswith("#8"))
    _, late, missed, _, _, p99, most, _, _, _ = map(int, told[3:].split(","))
    gaps = [(b - a) / FREQUENCY - PERIOD for a, b in pairwise(written)]
    outside = max(abs(gap) for gap in gaps if abs(gap) < 0.5 * PERIOD)
    assert len(written) > 190
    assert (late, missed) == (0, 0)
    assert outside < 0.03e-3, "the goal of a loop on the board is 0.2 ms"
    assert p99 * 1e-6 <= most * 1e-6 < 0.03e-3
    assert most * 1e-6 == pytest.approx(outside, abs=20e-6)


def test_a_busy_board_skips_no_update_at_1_khz(make_chip: Callable[[Path], Chip]) -> None:
    from rigctl.backends.emulated.image import shipped_image

    chip = make_chip(shipped_image(500000))
    begin(chip, period_ms=1, KD=0.01, TF=0.01, C2=1e-6, C3=1e-9)
    chip.send("STRM 1000", 0.5)
    chip.send("STRM 0")
    updates, late, *_ = figures(chip)
    assert updates > 500
    assert late == 0
