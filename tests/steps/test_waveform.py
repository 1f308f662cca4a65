"""Waveforms: which commands are given when, which waveforms are refused, and how they are interrupted."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rigctl.dataset import open_run
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.plan import Plan
from rigctl.planning import preview
from rigctl.rig import Rig, parse_rig
from rigctl.runner.operators.requests import Order, Request
from rigctl.runner.remaining_plan import record_paths, remaining
from rigctl.testing import ScriptedControl, VirtualBench
from run_workshop import Workshop

HEATERS = shipped("rigs", "heater-board.yaml")
LEVEL = 'heater_1: {kind: level, unit: "%", low: 0 %, high: 100 %'


MULTISINE = "multisine: {mean: 50 %, from: 0.1 Hz, to: 1 Hz"


def heaters(extra: str = "") -> Rig:
    """The heater board; `extra` is added to the entry of its first heater."""
    return parse_rig(HEATERS.read_text(encoding="utf-8").replace(LEVEL, LEVEL + extra))


def waveform(text: str) -> str:
    return f"steps:\n  - waveform: {{actuator: heater_1, {text}}}\n"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("ramp: {from: 10 %, to: 60 %, over: 20 s}", lambda t: 0.1 + 0.025 * t),
        (
            "sine: {mean: 50 %, amplitude: 20 %, frequency: 0.1 Hz, phase: 90 deg, for: 20 s}, rate: 20 Hz",
            lambda t: 0.5 + 0.2 * np.cos(0.2 * math.pi * t),
        ),
        ("steps: {levels: [20 %, 40 %], each: 10 s}", lambda t: np.where(t < 10.0, 0.2, 0.4)),
        ("steps: {levels: [20 %, 40 %], each: 5 s}, repeat: 2", lambda t: np.where(t % 10.0 < 5.0, 0.2, 0.4)),
        (
            "table: {points: [[0 s, 5 %], [10 s, 50 %], [20 s, 30 %]]}",
            lambda t: np.interp(t, [0.0, 10.0, 20.0], [0.05, 0.5, 0.3]),
        ),
        (
            "table: {points: [[0 s, 10 %], [4 s, 50 %], [20 s, 30 %]], between: hold}",
            lambda t: np.where(t < 4.0, 0.1, 0.5),
        ),
    ],
)
def test_the_commands_follow_the_waveform(
    tmp_path: Path, text: str, expected: Callable[[np.ndarray], np.ndarray]
) -> None:
    bench = VirtualBench(tmp_path, HEATERS)
    record = "  - record: {name: w, rate: 10 Hz}\n    do:\n      - " + waveform(text).partition("- ")[2]
    done = bench.run(f"steps:\n{record}", rig=heaters())
    assert done.result.folder is not None
    taken = open_run(done.result.folder).record(0)
    given = [switch for switch in taken.switches if switch.actuator == "heater_1"]
    time = np.array([switch.time - given[0].time for switch in given if switch.time < taken.end])
    value = np.array([switch.value for switch in given if switch.time < taken.end])
    assert value == pytest.approx(expected(time + 1e-9), abs=1e-6)
    # the command is a column of the samples: at each sample, the last command given before it
    seen = taken.commands["heater_1"]
    newest = np.searchsorted([switch.time for switch in given], taken.time, side="left") - 1
    later = newest >= 0
    assert later.sum() > 190
    assert seen[later] == pytest.approx(np.array([given[i].value for i in newest[later]]))


def test_a_multisine_has_its_lines_and_nothing_else(tmp_path: Path) -> None:
    bench = VirtualBench(tmp_path, HEATERS)
    text = f"{MULTISINE}, rms: 8 %, period: 20 s, lines: 6}}, rate: 20 Hz, repeat: 3, then: safe"
    (label,) = [node.label for node in bench.plan(waveform(text), heaters()).root.children]
    assert label.startswith("heater_1: multisine of 6 lines from 0.1 to 1 Hz, period 20 s, crest factor 1.")
    assert label.endswith(", for 60 s, 3 times")
    done = bench.run(waveform(text), rig=heaters())
    given = [(time, value) for time, value in done.commands("heater_1") if value]
    values = np.array([value for _, value in given[:1200]])
    assert [time - given[0][0] for time, _ in given[:1200]] == pytest.approx(np.arange(1200) / 20.0, abs=2e-3)
    spectrum = np.abs(np.fft.rfft(values)) / 600.0
    lines = np.flatnonzero(spectrum[1:] > 1e-9) + 1
    assert lines.tolist() == [
        6,
        9,
        15,
        24,
        39,
        60,
    ]  # three times the harmonics of a period: 2, 3, 5, 8, 13, 20
    assert spectrum[lines] == pytest.approx(0.08 * math.sqrt(2.0 / 6.0))
    assert values.mean() == pytest.approx(0.5)


def test_the_amplitude_of_a_multisine_is_its_largest_deviation(tmp_path: Path) -> None:
    text = f"{MULTISINE}, amplitude: 40 %, period: 10 s}}, rate: 200 Hz"
    done = VirtualBench(tmp_path, HEATERS).run(waveform(text), rig=heaters())
    values = np.array([value for _, value in done.commands("heater_1") if value])
    assert np.abs(values - 0.5).max() == pytest.approx(0.4, rel=1e-3)


def test_a_multisine_that_its_record_would_not_show_is_refused(tmp_path: Path) -> None:
    step = "- waveform: {actuator: heater_1, " + MULTISINE + ", amplitude: 9 %}}"
    for rate, refused in (("2 Hz", True), ("2.5 Hz", False)):
        text = f"steps:\n  - record: {{name: w, rate: {rate}}}\n    do:\n      {step}\n"
        if refused:
            with pytest.raises(
                RigctlError, match=r"sampled too slowly for its highest line of 1 Hz.* above 2 Hz"
            ):
                VirtualBench(tmp_path, HEATERS).plan(text, heaters())
        else:
            assert VirtualBench(tmp_path, HEATERS).plan(text, heaters())


def test_a_table_is_read_from_a_file_with_units(tmp_path: Path) -> None:
    (tmp_path / "drive.csv").write_text("time [min],heater_1 [%]\n5,10\n5.5,40\n6,20\n", encoding="utf-8")
    text = waveform("table: {file: drive.csv}, then: safe").replace("steps", "procedure: t\nsteps", 1)
    (tmp_path / "p.yaml").write_text(text, encoding="utf-8")
    bench = VirtualBench(tmp_path, HEATERS)
    done = bench.run(tmp_path / "p.yaml")
    values = [value for _, value in done.commands("heater_1")]
    assert (max(values), values[-1]) == (pytest.approx(0.4), 0.0)
    assert preview(bench.plan(tmp_path / "p.yaml")).seconds == pytest.approx(60.0)
    for content, said in [
        ("time [s],heater_1 [%]\n0,10\n1,120\n", "out of range"),
        ("time [s],heater_1 [K]\n0,10\n1,20\n", "wrong dimension"),
        ("time [s],heater_2 [%]\n0,10\n1,20\n", "one column 'heater_1'"),
        ("time [s],heater_1 [%]\n0,10\n0,20\n", "the time does not increase"),
        ("time [s],heater_1 [%]\n0,10\n1,much\n", "no number"),
    ]:
        (tmp_path / "drive.csv").write_text(content, encoding="utf-8")
        with pytest.raises(RigctlError, match=said) as caught:
            bench.plan(tmp_path / "p.yaml")
        assert caught.value.where.line in (1, 3)


@pytest.mark.parametrize(
    ("text", "extra", "said"),
    [
        ("ramp: {from: 0 %, to: 110 %, over: 1 s}", "", "out of range"),
        ("sine: {mean: 90 %, amplitude: 20 %, frequency: 1 Hz, for: 9 s}", "", "out of range .* at 0.1 s"),
        ("ramp: {from: 0 %, to: 50 %, over: 5 s}", ", max_rate: 9 %/s", "faster than 'heater_1' may be"),
        ("steps: {levels: [0 %, 10 %], each: 60 s}", ", max_rate: 9 %/s", "10 % at once"),
        ("steps: {levels: [0 %, 10 %], each: 1 s}", ", min_interval: 2 s", "too often, at 1 s"),
        ("steps: {levels: [0 %, 10 %], each: 1 ns}", "", "too often, at 1e-09 s.* at least 0.001 s"),
        ("table: {points: [[0 s, 0 %], [1 us, 1 %]], between: hold}", "", "too often, at 1e-06 s"),
        (
            "ramp: {from: 0 %, to: 1 %, over: 1 ms}, rate: 1 MHz",
            "",
            "a 'rate' of 1e[+]06 Hz.* at most 1000 Hz",
        ),
        (
            "ramp: {to: 50 %, over: 5 s}, sine: {mean: 1 %, amplitude: 1 %, frequency: 1 Hz, for: 1 s}",
            "",
            "two",
        ),
        ("rate: 1 Hz", "", "needs a shape"),
        (
            "sine: {mean: 50 %, amplitude: 9 %, frequency: 50 Hz, for: 1 s}, rate: 5 Hz",
            "",
            "too few commands",
        ),
        ("ramp: {from: 0 %, to: 1 %, over: 1e8 s}", "", "too many commands"),
        ("steps: {levels: [0 %, 10 %], each: 1 s, rise: 2 s}", "", "longer than a step"),
        ("ramp: {from: 0 bar, to: 10 bar, over: 1 s}", "", "wrong dimension"),
        (f"{MULTISINE}, amplitude: 60 %}}", "", "out of range"),
        (f"{MULTISINE}, amplitude: 40 %}}", ", max_rate: 20 %/s", "faster than 'heater_1' may be"),
        (f"{MULTISINE}, amplitude: 9 %}}, rate: 1 Hz", "", "too few commands for a multisine.* above 2 Hz"),
        (f"{MULTISINE}, amplitude: 9 %}}", ", min_interval: 600 ms", "every 0.6 s at most.* below 0.83"),
        (f"{MULTISINE}, amplitude: 9 %}}", ", min_interval: 300 ms", "too often, at 0.1 s"),
        (f"{MULTISINE}}}", "", "either 'amplitude' or 'rms'"),
        (f"{MULTISINE}, amplitude: 9 %, rms: 3 %}}", "", "either 'amplitude' or 'rms'"),
        (f"{MULTISINE}, amplitude: 9 %, period: 1 s, lines: 2}}", "", "so many lines.* 1 to 1"),
        (f"{MULTISINE}, amplitude: 9 %, period: 1 h}}", "", "too many lines"),
        (
            "multisine: {mean: 5 %, from: 30 mHz, to: 30 mHz, amplitude: 1 %, period: 10 s}",
            "",
            "no multiple of 1/period",
        ),
    ],
)
def test_a_waveform_that_the_rig_cannot_follow_is_refused_before_anything_moves(
    tmp_path: Path, text: str, extra: str, said: str
) -> None:
    with pytest.raises(RigctlError, match=said) as caught:
        VirtualBench(tmp_path, HEATERS).plan(waveform(text), heaters(extra))
    assert caught.value.where.line == 3


def test_between_rounds_of_a_held_table_only_its_first_row_is_commanded(tmp_path: Path) -> None:
    """It used to be commanded for zero time, and the log to state that the host was late."""
    points = "points: [[0 s, 10 %], [2 s, 30 %], [4 s, 20 %]], between: hold"
    done = VirtualBench(tmp_path, HEATERS).run(waveform(f"table: {{{points}}}, repeat: 2"), rig=heaters())
    given = [(time, round(100 * value)) for time, value in done.commands("heater_1") if value]
    begin = given[0][0]
    assert [(pytest.approx(time - begin, abs=0.01), level) for time, level in given] == [
        (0.0, 10),
        (2.0, 30),
        (4.0, 10),
        (6.0, 30),
        (8.0, 20),
    ]
    assert not [note for note in done.messages("note") if "left out" in note]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("root:$6$SECRET:19000:0:99999::SECRET\n", "'time' is expected, got '0 of 1 columns'"),
        ("-----BEGIN KEY-----\nSECRET\n", "'time' is expected, got '0 of 1 columns'"),
        (f"time [s],{'SECRET' * 30_000}\n", "cannot read the table: field larger than field limit"),
    ],
)
def test_the_content_of_an_invalid_table_file_is_not_quoted(tmp_path: Path, content: str, said: str) -> None:
    """A procedure from someone else may name any file; its first line used to be in the message."""
    (tmp_path / "drive.csv").write_text(content, encoding="utf-8")
    table = f"table: {{file: {(tmp_path / 'drive.csv').as_posix()}}}"
    with pytest.raises(RigctlError, match=said) as caught:
        VirtualBench(tmp_path, HEATERS).plan(waveform(table), heaters())
    assert "SECRET" not in str(caught.value)


def test_an_overlong_or_irregular_table_file_is_refused_unread(tmp_path: Path) -> None:
    """``/dev/zero`` used to fill the memory."""
    with (tmp_path / "long.csv").open("wb") as file:
        file.truncate(10**9)
    for name, said in (("long.csv", "too long"), (".", "cannot read the table")):
        with pytest.raises(RigctlError, match=said):
            table = f"table: {{file: {(tmp_path / name).as_posix()}}}"
            VirtualBench(tmp_path, HEATERS).plan(waveform(table), heaters())


def test_positions_allow_steps_only_and_manual_actuators_no_waveform(steps: Callable[..., Plan]) -> None:
    with pytest.raises(RigctlError, match="positions and nothing between"):
        steps("- waveform: {actuator: valve, ramp: {from: neutral, to: extend, over: 1 s}}")
    with pytest.raises(RigctlError, match="turned by hand"):
        steps("- waveform: {actuator: relief_valve, ramp: {from: 20 bar, to: 30 bar, over: 1 s}}")


def test_a_set_point_is_checked_against_the_limits_of_its_channel(tmp_path: Path) -> None:
    written = shipped("rigs", "oil-circuit-modbus.yaml").read_text(encoding="utf-8")
    rig = parse_rig(written.replace("above: 65 bar", "above: 50 bar"))
    text = "steps:\n  - waveform: {actuator: relief_valve, ramp: {from: 10 bar, to: 59 bar, over: 2 s}}\n"
    with pytest.raises(RigctlError, match="would trip the limit"):
        VirtualBench(tmp_path).plan(text, rig)


def test_the_approach_to_the_first_value_of_a_waveform_respects_the_rate_limit(tmp_path: Path) -> None:
    bench = VirtualBench(tmp_path, HEATERS)
    done = bench.run(
        waveform("steps: {levels: [40 %], each: 1 s}") + "  - waveform: {actuator: heater_1, "
        "ramp: {to: 10 %, over: 10 s}}\n",
        rig=heaters(", max_rate: 10 %/s"),
    )
    assert done.result.status == "finished"
    given = done.commands("heater_1")
    (t, v) = (np.array(column) for column in zip(*given, strict=True))
    apart = np.diff(t) > 0.0  # the end of the run comes at the time of the last command
    t, v = t[: apart.sum() + 1], v[: apart.sum() + 1]
    fast = np.diff(v) / np.diff(t)
    last_ramp = fast[(t[1:] < t[-1]) & (v[1:] > 0.0)]
    assert np.abs(last_ramp).max() <= 0.1 * (1.0 + 1e-6)
    assert v.max() == pytest.approx(0.4)


def test_a_ramp_from_the_current_value_that_is_too_fast_fails_the_run(tmp_path: Path) -> None:
    steps = (
        "steps:\n  - set: {heater_1: 90 %}\n  - waveform: {actuator: heater_1, ramp: {to: 0 %, over: 1 s}}\n"
    )
    done = VirtualBench(tmp_path, HEATERS).run(steps, rig=heaters(", max_rate: 10 %/s"))
    assert done.result.status == "failed"
    assert "faster than 'heater_1' may be" in str(done.result.reason)
    times, values = (np.array(each) for each in zip(*done.commands("heater_1"), strict=True))
    assert values[-2:].tolist() == [pytest.approx(0.9), 0.0]
    # the value before it was set at the same rate, and the waveform commanded nothing
    rates = np.diff(values[:-1], prepend=0.0)[1:] / np.diff(times[:-1])
    assert np.all((rates > 0.0) & (rates < 0.11))


def test_an_interlock_ends_a_waveform_with_outputs_safe(tmp_path: Path) -> None:
    text = waveform("sine: {mean: 50 %, amplitude: 10 %, frequency: 0.1 Hz, for: 60 s}")
    done = VirtualBench(tmp_path, HEATERS).run(
        text, rig=heaters(), options={"faults": ("sensor_out_of_range:temperature_1@20 s",)}
    )
    assert done.result.status == "failed"
    commands = done.commands("heater_1")
    assert commands[-1][1] == 0.0
    assert commands[-2][0] < 30.0


class Person(ScriptedControl):
    """Pauses once, and continues the run as soon as it is paused."""

    def poll(self) -> list[Order]:
        if self.views and self.views[-1].state == "paused":
            self.orders.append((0.0, Request.CONTINUE))
        return super().poll()


def test_a_waveform_restarts_after_a_pause(tmp_path: Path) -> None:
    text = waveform("ramp: {from: 10 %, to: 60 %, over: 20 s}")
    done = VirtualBench(tmp_path, HEATERS).run(text, control=Person([(10.0, Request.PAUSE)]))
    assert done.result.status == "finished"
    values = [value for _, value in done.commands("heater_1")]
    paused = values.index(0.0)
    assert 0.2 < values[paused - 1] < 0.4
    assert values[paused + 1] == pytest.approx(0.1)
    assert max(values) == pytest.approx(0.6)


def test_a_resumed_run_repeats_lasting_settings(tmp_path: Path) -> None:
    record = "  - record: {name: r}\n    do:\n      - wait: 1 s\n"
    lasting = waveform("ramp: {to: 60 %, over: 20 s}")
    passing = waveform("ramp: {to: 60 %, over: 20 s}, then: safe")
    for text, left in ((lasting, 2), (passing, 1)):
        plan = VirtualBench(tmp_path, HEATERS).plan(text + record + record)
        first = record_paths(plan.root)[0]
        assert len(remaining(plan.root.children, lambda path, first=first: path == first)) == left


def test_valves_follow_steps_of_positions(tmp_path: Path) -> None:
    steps = (
        "steps:\n  - waveform: {actuator: valve, steps: {levels: [extend, neutral, retract], each: 500 ms}, "
        "then: safe}\n"
    )
    done = Workshop(tmp_path).run(steps)
    given = done.commands("valve")
    times, values = zip(*given, strict=True)
    assert values == (1.0, 0.0, -1.0, 0.0)
    assert np.diff(times) == pytest.approx(0.5)
