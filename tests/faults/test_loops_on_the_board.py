"""A `control` step with its loop on the board: its data, and its safe endings."""

from __future__ import annotations

import random
import sys
from binascii import crc_hqx
from pathlib import Path

import numpy as np
import pytest

from board_workshop import BoardWorkshop
from rigctl.backends.emulated.board import EmulatedBoard
from rigctl.dataset import open_run
from rigctl.errors import RigctlError
from rigctl.planning.rates import refuse_rates
from rigctl.rig import Limit
from rigctl.runner.operators.requests import Order, Request
from run_workshop import Done, ScriptedControl, Workshop

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="simavr is packaged for Linux only")

BAR = 1e5
LOOP = "actuator: relief_valve, channel: supply_pressure, to: 30 bar, gain: 0.5, integral: 8 1/s"


@pytest.fixture
def board(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> BoardWorkshop:
    return BoardWorkshop(Workshop(tmp_path), monkeypatch, driven=True)


def recorded(fields: str = "rate: 100 Hz, where: board, for: 1.2 s", rate: int = 100) -> str:
    return (
        f"steps:\n  - record: {{name: loop, rate: {rate} Hz}}\n"
        f"    do:\n      - control: {{{LOOP}, {fields}}}\n"
    )


def alone(fields: str = "rate: 100 Hz, where: board, for: 1.2 s") -> str:
    return f"steps:\n  - control: {{{LOOP}, {fields}}}\n"


def loop_runs(board: EmulatedBoard) -> bool:
    """Asked of the board itself."""
    board.avr.take()
    board.avr.send(b"STRM 0\n#999 CONT?\n")
    board.run_to(board.time + 0.06)
    (answer,) = (line for line in board.avr.take().decode().splitlines() if line.startswith("#999"))
    return answer.startswith("#999 1")


def test_a_loop_on_the_board_is_recorded_with_its_output(board: BoardWorkshop) -> None:
    done = board.run(recorded("rate: 200 Hz, where: board, ramp: 40 bar/s, for: 1.5 s"), noise="off")
    assert done.result.status == "finished", done.result.reason
    record = open_run(done.result.folder).record(0)
    pressure, level = record.channels["supply_pressure"] / BAR, record.commands["relief_valve"] / BAR
    assert pressure[-3] == pytest.approx(30.0, abs=0.3)
    assert pressure.max() < 32.5
    given = [(time, value / BAR) for time, value in done.commands("relief_valve")]
    assert len(given) > 50, "twice as fast as the samples, which bear every output they were taken under"
    times, values = (np.array(column) for column in zip(*given, strict=True))
    at = np.searchsorted(times, record.time + 1e-6, side="right") - 1
    inside = (at > 0) & (record.time < times[-1])
    assert np.abs(values[at[inside]] - level[inside]).max() < 0.1, "samples and log say the same"
    kept = record.measures
    assert 0.0 < kept["control_jitter_p99"] <= kept["control_jitter_max"] < 0.2e-3
    assert kept["control_latency_p99"] < 1e-3
    assert given[-1][1] == 10.0
    assert board.script.board.avr.pwm == 0.0
    assert "the loop runs on the board: supply_pressure to 30 bar, once in 5 ms" in done.messages("note")


def test_the_option_then_stay_keeps_the_output_until_the_end_of_the_run(
    board: BoardWorkshop,
) -> None:
    fields = "rate: 100 Hz, where: board, within: 0.5 bar, settle: 0.2 s, timeout: 3 s, then: stay"
    done = board.run(f"{alone(fields)}  - wait: 0.5 s\n", noise="off")
    assert done.result.status == "finished", done.result.reason
    run = open_run(done.result.folder)
    (*_, (before, stayed), (last, safe)) = done.commands("relief_valve")
    assert stayed / BAR == pytest.approx(30.0, abs=1.5)
    assert last - before >= 0.5
    assert safe / BAR == 10.0
    assert {one["name"] for one in run.info["measures"]} >= {"control_jitter_max", "control_saturated"}


def test_feed_forward_is_applied_by_the_loop_on_the_board(board: BoardWorkshop) -> None:
    fields = LOOP.replace("gain: 0.5, integral: 8 1/s", "gain: 0")
    more = "feed_forward: setpoint + 1 bar, ramp: 30 bar/s, rate: 50 Hz, where: board, for: 1.5 s"
    done = board.run(f"steps:\n  - control: {{{fields}, {more}}}\n", noise="off")
    assert done.result.status == "finished", done.result.reason
    values = [value / BAR for _, value in done.commands("relief_valve")]
    assert max(values) == pytest.approx(31.0, abs=0.1)
    assert len(set(values)) > 10, "along the ramp"


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ("limit", "about to reach its end stop"),
        ("oscillation", "the loop oscillates"),
        ("abort", "ended by a test"),
        ("lost", "injected fault"),
        ("restart", "no sample for 1 s"),
        ("trip", "the board has tripped: sensor open"),
    ],
)
def test_every_ending_stops_the_loop_with_its_output_safe(
    board: BoardWorkshop, how: str, reason: str
) -> None:
    script, text = board.script, recorded("rate: 100 Hz, where: board, for: 3 s")
    control = ScriptedControl([(1.0, Request.ABORT)] if how == "abort" else [])
    faults = {"lost": "backend_lost@1 s..60 s", "trip": "sensor_out_of_range:supply_pressure@1 s"}
    if how == "limit":
        script.at(0.5, lambda one: one.device.command("valve", 1.0, one.time, None))
    if how == "restart":
        script.at(1.0, lambda one: one.avr.reset())
    if how == "oscillation":
        text = recorded("rate: 10 Hz, where: board, for: 6 s")
        text = text.replace("gain: 0.5, integral: 8 1/s", "gain: 100, start: zero")
        text = text.replace("30 bar", "32.5 bar")
    bench = board.bench(noise="off", faults=[faults[how]] if how in faults else [])
    bench.open()
    done = board.workshop.run(text, rig=board.rig(), backend=bench, control=control)
    chip = script.board
    if how == "lost":
        chip.run_to(chip.time + 2.0)  # the host could not reach it
        assert "relief_valve" in str(done.result.unconfirmed)
    assert done.result.status == ("aborted" if how == "abort" else "failed")
    assert reason in str(done.result.reason)
    assert max(value for _, value in done.commands("relief_valve")) > 20 * BAR
    assert chip.avr.pwm == 0.0
    assert not loop_runs(chip)


@pytest.mark.parametrize("where", ["board", "host"])
@pytest.mark.parametrize("fault", ["sensor_stuck", "sensor_open", "samples_stop"])
def test_a_sensor_that_fails_in_a_loop_ends_it_with_its_output_safe(
    board: BoardWorkshop, fault: str, where: str
) -> None:
    """A reading stuck below the set-point used to keep the output at its bound until the end of the step."""
    stuck = Limit.model_validate(
        {"channel": "supply_pressure", "unchanged": "0.6 s", "while_on": "relief_valve"}
    )
    rig = board.rig()
    rig = rig.model_copy(update={"limits": {**rig.limits, "transducer_stuck": stuck}})
    injected = f"{fault}@1 s" if fault == "samples_stop" else f"{fault}:supply_pressure@1 s"
    bench = board.bench(faults=[injected])
    bench.open()
    text = recorded(f"rate: 50 Hz, where: {where}, for: 6 s")
    done = board.workshop.run(text, rig=rig, backend=bench)
    assert done.result.status == "failed"
    expected = {"sensor_stuck": "has read exactly", "samples_stop": "no sample for 1 s"}
    assert expected.get(fault, "sensor") in str(done.result.reason)
    assert max(value for _, value in done.commands("relief_valve")) > 20 * BAR
    assert board.script.board.avr.pwm == 0.0
    assert not loop_runs(board.script.board)


def test_between_records_a_loop_restarts_after_a_loss_of_contact(board: BoardWorkshop) -> None:
    done = board.run(alone("rate: 100 Hz, where: board, for: 3 s"), faults=["backend_lost@1 s..1.6 s"])
    assert done.result.status == "finished", done.result.reason
    assert any("started again" in text for text in done.messages("note"))
    late = [value / BAR for time, value in done.commands("relief_valve") if time > 2.5]
    assert late[0] == pytest.approx(30.0, abs=4.0)


def test_between_records_a_loop_on_the_host_continues_after_a_loss_of_contact(board: BoardWorkshop) -> None:
    done = board.run(alone("rate: 20 Hz, for: 3 s"), faults=["backend_lost@1 s..1.6 s"])
    assert done.result.status == "finished", done.result.reason
    late = [value / BAR for time, value in done.commands("relief_valve") if time > 2.75]
    assert late[0] == pytest.approx(30.0, abs=2.0), "a second after it went on it has settled"


@pytest.mark.parametrize(
    ("where", "to"),
    [("host", "30 bar"), ("board", "30 bar"), ("board", "5 bar")],
    ids=["host-above", "board-above", "board-at the safe value"],
)
def test_in_a_record_a_loss_of_contact_during_a_loop_fails_the_run(
    board: BoardWorkshop, where: str, to: str
) -> None:
    """The loop used to be restarted, and the record to be kept as complete.

    A loop on the host whose output is at its safe value is not interrupted: the output is what it commanded.
    """
    text = recorded(f"rate: 100 Hz, where: {where}, for: 3 s").replace("to: 30 bar", f"to: {to}")
    done = board.run(text, noise="off", faults=["backend_lost@1.2 s..1.8 s"])
    assert done.result.status == "failed", done.messages("note")
    assert "went to the safe state" in str(done.result.reason)


def test_a_loop_that_cannot_be_stopped_is_reported_even_with_its_output_safe(board: BoardWorkshop) -> None:
    """It may command another value a moment later."""
    text = recorded("rate: 100 Hz, where: board, for: 3 s").replace("to: 30 bar", "to: 5 bar")
    done = board.run(text, noise="off", faults=["backend_lost@1 s..60 s"])
    (*_, (_, newest)) = done.commands("relief_valve")
    assert newest == 10 * BAR, "when contact was lost, it was safe"
    assert "relief_valve" in str(done.result.unconfirmed)


def test_the_output_of_a_loop_is_safe_before_the_next_step(board: BoardWorkshop) -> None:
    done = board.run(f"{alone('rate: 100 Hz, where: board, for: 1 s')}  - wait: 1 s\n", noise="off")
    assert done.result.status == "finished", done.result.reason
    (*_, (last, safe)) = done.commands("relief_valve")
    assert safe / BAR == 10.0
    assert last < done.result.duration - 0.9


def test_lost_and_damaged_lines_do_not_disturb_a_loop(board: BoardWorkshop) -> None:
    chance = random.Random(5)

    def bad_line(line: bytes, time: float) -> list[bytes]:
        fate = chance.random() if time > 0.3 else 1.0
        return [] if fate < 0.12 else [line[:4] + b"?" + line[5:] if fate < 0.2 else line]

    board.script.arriving = bad_line
    done = board.run(alone("rate: 100 Hz, where: board, for: 1.2 s"), noise="off")
    assert done.result.status == "finished", done.result.reason
    assert not any("started again" in text for text in done.messages("note"))
    values = [value / BAR for _, value in done.commands("relief_valve")]
    assert max(values) > 30.0
    assert values[-1] == 10.0
    assert {one["name"] for one in open_run(done.result.folder).info["measures"]} >= {"control_jitter_max"}


def test_a_loop_that_cannot_be_started_fails_the_run(board: BoardWorkshop) -> None:
    def no_answers(line: bytes, time: float) -> list[bytes]:
        return [] if 0.35 < time < 9.0 and line.startswith(b"#") else [line]

    board.script.arriving = no_answers
    done = board.run(alone("rate: 100 Hz, where: board, for: 0.8 s"), noise="off")
    assert done.result.status == "failed"
    assert "the loop could not be started on the board" in str(done.result.reason)


class Person(ScriptedControl):
    """Continues the run as soon as it is paused."""

    def poll(self) -> list[Order]:
        if self.views and self.views[-1].state == "paused":
            self.orders.append((0.0, Request.CONTINUE))
        return super().poll()


def test_a_pause_restarts_the_loop(board: BoardWorkshop) -> None:
    bench = board.bench(noise="off")
    bench.open()
    control = Person([(0.8, Request.PAUSE)])
    done = board.workshop.run(alone(), rig=board.rig(), backend=bench, control=control)
    assert done.result.status == "finished", done.result.reason
    given = [(time, value / BAR) for time, value in done.commands("relief_valve")]
    paused = next(time for time, value in given if time > 0.75 and value == 10.0)
    again = next(time for time, value in given if time > paused and value > 10.0)
    assert again > paused
    assert "paused, outputs are safe" in control.answers
    assert max(value for time, value in given if time < paused) > 20.0
    assert board.script.board.avr.pwm == 0.0


# --- before anything moves ----------------------------------------------------------------------------------


def old_firmware(line: bytes, _: float) -> list[bytes]:
    """The line of a board with firmware that has no control loop yet."""
    if b"RIG-UNO,0,1.1" not in line:
        return [line]
    body = line.rpartition(b"*")[0].replace(b",1.1.1", b",1.0.1")
    return [b"%s*%04X\n" % (body, crc_hqx(body, 0))]


def test_a_board_without_a_loop_is_refused_before_anything_moves(board: BoardWorkshop) -> None:
    board.script.arriving = old_firmware
    done = board.run(alone())
    assert done.result.status == "failed"
    reason = str(done.result.reason)
    assert "the board's firmware (1.0.1) has no closed loop; it needs 1.1 or later: flash the image" in reason
    assert {value for _, value in done.commands("relief_valve")} <= {10 * BAR}


def test_auto_runs_the_loop_on_the_host_with_a_reason(board: BoardWorkshop) -> None:
    board.script.arriving = old_firmware
    done = board.run(alone("rate: 50 Hz, where: auto, for: 0.5 s"))
    assert done.result.status == "finished", done.result.reason
    assert any(
        "the loop runs on the host: the board's firmware (1.0.1)" in text for text in done.messages("note")
    )
    assert len(done.commands("relief_valve")) > 20


def test_auto_uses_the_host_on_a_simulated_bench(tmp_path: Path, board: BoardWorkshop) -> None:
    def simulate(where: str) -> Done:
        text = alone(f"rate: 50 Hz, where: {where}, for: 0.5 s")
        return Workshop(tmp_path / where).run(text, rig=board.rig())

    refused = simulate("board")
    assert "'where: board': a bench of the kind 'simulated' has no controller" in str(refused.result.reason)
    assert {value for _, value in refused.commands("relief_valve")} <= {10 * BAR}
    assert simulate("auto").result.status == "finished"


def test_auto_runs_a_period_of_fractional_milliseconds_on_the_host(board: BoardWorkshop) -> None:
    done = board.run(alone("rate: 30 Hz, where: auto, for: 1 s"), noise="off")
    assert done.result.status == "finished", done.result.reason
    assert any("the loop runs on the host: a period of 33.3333 ms" in text for text in done.messages("note"))


def test_a_period_of_fractional_milliseconds_is_refused_with_its_place(board: BoardWorkshop) -> None:
    with pytest.raises(
        RigctlError, match=r"whole milliseconds.*got '30 Hz'.*e\.g\. 30\.303 Hz, 33 ms"
    ) as caught:
        board.workshop.plan(alone("rate: 30 Hz, where: board, for: 1 s"), board.rig())
    assert caught.value.where.line == 3
    fast = board.workshop.plan(recorded("rate: 500 Hz, where: board, for: 1 s", rate=20), board.rig())
    refuse_rates(fast, "emulated")  # a line carries 320 samples a second, and the loop needs none of them
