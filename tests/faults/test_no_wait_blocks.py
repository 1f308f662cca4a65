"""No wait blocks interlocks, samples or endings; on every kind of bench."""

from __future__ import annotations

import sys
import threading
from itertools import pairwise
from pathlib import Path

import pytest

from bench_stand import ScriptedClock, Stand
from rigctl.backends.registry import create_backend
from rigctl.clock import ScaledClock
from rigctl.dataset import open_run, verify
from rigctl.errors import ExitCode
from run_workshop import Workshop

EMULATED = pytest.param(
    "emulated", marks=pytest.mark.skipif(sys.platform != "linux", reason="simavr is packaged for Linux only")
)
KINDS = ["simulated", EMULATED, "lines"]
LONG_REST = {
    "simulated": ("min_interval: 2 s", "min_interval: 10 s"),
    "emulated": ("min_interval: 2 s", "min_interval: 10 s"),
    "lines": ('heater_1: {kind: level, unit: "%",', 'heater_1: {kind: level, unit: "%", min_interval: 10 s,'),
}
#: switches one output on, off, and on again, which has to wait for 10 s
RESTING = {
    "cylinder": "steps:\n  - set: {heater: on}\n  - wait: 1 s\n  - set: {heater: off}\n"
    "  - set: {valve: extend}\n  - set: {heater: on}\n  - wait: 1 s\n",
    "heaters": "steps:\n  - set: {heater_1: 50 %}\n  - wait: 1 s\n  - set: {heater_1: 0 %}\n"
    "  - set: {heater_2: 30 %}\n  - set: {heater_1: 50 %}\n  - wait: 1 s\n",
}


@pytest.fixture(params=KINDS)
def stand(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Stand:
    return Stand(request.param, Workshop(tmp_path), monkeypatch)


def steps_for(stand: Stand) -> str:
    return RESTING["heaters" if stand.kind == "lines" else "cylinder"]


def test_a_signal_ends_a_wait_for_an_actuator_to_rest(stand: Stand) -> None:
    pressed = 4.0 if stand.kind == "lines" else 2.0
    stand.signal_at(pressed)
    done = stand.run(steps_for(stand), stand.rig(LONG_REST[stand.kind]))
    assert (done.result.status, done.result.exit_code) == ("aborted", ExitCode.INTERRUPTED)
    # a line device is identified again after its outputs were read back
    assert done.result.duration < pressed + (0.6 if stand.kind == "lines" else 0.5)
    on = [entry for entry in stand.seen if entry[2] != 0.0]
    assert len(on) == 2, "what waited was dropped"
    assert stand.on_after(pressed) == []
    assert stand.is_off()
    last = max(time for time, _, _ in stand.seen)
    assert last - pressed < (
        0.6 if stand.kind == "lines" else 0.12
    )  # a sample of that board takes up to 0.5 s


@pytest.mark.parametrize("kind", ["simulated", EMULATED])
def test_a_signal_acts_between_two_samples(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between records the bench is read ten times a second; a signal must act before the next sample."""
    clock = ScriptedClock(speed=1.0)  # virtual, but sleeps in slices, between which signals are checked
    stand = Stand(kind, Workshop(tmp_path), monkeypatch, clock=clock)
    stand.signal_at(2.0213)
    done = stand.run("steps:\n  - set: {heater: on}\n  - wait: 60 s\n")
    assert done.result.status == "aborted"
    assert max(time for time, _, _ in stand.seen) - 2.0213 < 0.035


def test_sampling_continues_while_an_actuator_rests(stand: Stand) -> None:
    steps = steps_for(stand).replace("  - set: {valve: extend}\n", "")
    done = stand.run(steps, stand.rig(LONG_REST[stand.kind]))
    assert done.result.status == "finished", done.result.reason
    name = "heater_1" if stand.kind == "lines" else "heater"
    first_off = next(
        time for time, which, value in stand.seen if which == name and value == 0.0 and time > 0.5
    )
    second_on = [time for time, which, value in stand.seen if which == name and value != 0.0][1]
    assert second_on - first_off == pytest.approx(10.0, abs=0.05)
    times = open_run(done.result.folder).samples()["time"].tolist()
    assert max(b - a for a, b in pairwise(times)) < 0.6  # the heater board is read twice a second
    assert second_on <= done.result.duration - 1.0, "the step after it waits for it"


def test_an_interlock_trips_while_an_actuator_rests(stand: Stand) -> None:
    change = LONG_REST[stand.kind]
    if stand.kind == "lines":

        def boil() -> None:
            assert stand.port is not None
            model = stand.port.sketch.model
            model._T2 = model._H2 = 130.0

        stand.clock.at(5.0, boil)
        cause, latest = "eater 2", 9.0
    else:
        cause, latest = "about to reach its end stop", 5.0
    done = stand.run(steps_for(stand), stand.rig(change))
    assert done.result.status == "failed"
    assert cause in done.result.reason
    assert done.result.duration < latest
    assert stand.is_off()
    assert len([entry for entry in stand.seen if entry[2] != 0.0]) == 2


def test_a_wait_for_the_operator_does_not_hide_a_silent_bench(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand = Stand("simulated", Workshop(tmp_path), monkeypatch)
    rig = stand.rig()
    backend = stand._simulated(rig, {"faults": ["samples_stop@2 s"]})
    backend.open()

    class Nobody:
        name = typed = ""
        present = True

        def ask(self, question: object) -> None:
            return None

        def withdraw(self, question: object) -> None: ...

    stand.signal_at(60.0)
    done = stand.workshop.run("steps:\n  - prompt: go on\n", rig=rig, backend=backend, operator=Nobody())
    assert "no sample for 1 s" in done.result.reason
    assert done.result.duration < 4.0


@pytest.mark.parametrize("moment", [0.52, 0.55, 0.59])
def test_a_stall_of_the_computer_is_not_taken_for_a_silent_bench(
    moment: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bench kept sampling; only the host's check for a sample was late."""
    stand = Stand("simulated", Workshop(tmp_path), monkeypatch)
    wall, stood = [0.0], []

    def sleep(seconds: float) -> None:
        wall[0] += seconds
        if wall[0] > moment and not stood:
            stood.append(wall[0])
            wall[0] += 3.0

    rig = stand.rig()
    clock = ScaledClock(monotonic=lambda: wall[0], sleep=sleep)
    backend = create_backend(rig, "simulated", clock, {"plant": "roles"})
    backend.open()
    done = stand.workshop.run("steps:\n  - wait: 5 s\n", rig=rig, backend=backend)
    assert stood
    assert done.result.status == "finished", done.result.reason


def test_a_display_that_blocks_does_not_block_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand = Stand("simulated", Workshop(tmp_path), monkeypatch)
    never, shown = threading.Event(), threading.Event()

    def display(_view: object) -> None:
        shown.set()
        never.wait()

    rig = stand.rig()
    backend = create_backend(rig, "simulated", ScaledClock(speed=20.0), {"plant": "roles"})
    backend.open()
    done = stand.workshop.run("steps:\n  - wait: 10 s\n", rig=rig, backend=backend, observer=display)
    assert shown.is_set()
    assert done.result.status == "finished"
    never.set()


RETRIED = """\
steps:
  - set: {OUTPUT: ON}
  - record: {name: r, rate: 2 Hz, retries: 2}
    do:
      - wait: 8 s
"""


def retried(stand: Stand) -> str:
    output, on = ("heater_1", "60 %") if stand.kind == "lines" else ("heater", "on")
    return RETRIED.replace("OUTPUT", output).replace("ON", on)


def lose(stand: Stand, begin: float, end: float) -> dict[str, object]:
    """Disconnect for a time; returns the options of the backend for this."""
    if stand.kind != "lines":
        return {"faults": [f"backend_lost@{begin} s..{end} s"]}

    def pull(gone: bool) -> None:
        assert stand.port is not None
        stand.port.gone = gone

    stand.clock.at(begin, lambda: pull(True))
    stand.clock.at(end, lambda: pull(False))
    return {}


def test_a_signal_ends_the_wait_for_a_lost_bench_whose_record_would_be_repeated(stand: Stand) -> None:
    options = lose(stand, 3.0, 25.0)
    stand.signal_at(8.0)
    done = stand.run(retried(stand), **options)
    assert done.result.status == "aborted"
    assert done.result.duration < 20.0  # before it is back; virtual time has no slices in which to look
    assert stand.on_after(3.0) == []


def test_a_record_whose_set_up_switches_the_heater_can_be_repeated(stand: Stand) -> None:
    done = stand.run(retried(stand), **lose(stand, 4.0, 8.0))
    assert done.result.status == "finished", done.result.reason
    assert [outcome for _, outcome in done.records] == ["interrupted", "complete"]
    on = [time for time, _, value in stand.seen if value != 0.0]
    assert len(on) == 2
    run = open_run(done.result.folder)
    output = "heater_1" if stand.kind == "lines" else "heater"
    assert (run.samples(record=1)[output] != 0.0).all(), "as commanded from the first sample to the last"
    assert verify(done.result.folder).good


@pytest.mark.parametrize("inside", [True, False])
def test_outputs_switched_off_in_a_short_loss_fail_the_run_and_stay_off(stand: Stand, inside: bool) -> None:
    steps = retried(stand).replace(", retries: 2", "")
    if not inside:
        steps = steps.replace("  - record", "  - wait: 10 s\n  - record")
    done = stand.run(steps, **lose(stand, 5.0, 5.8))
    assert done.result.status == "failed"
    assert done.result.exit_code == ExitCode.FAILED
    assert "went to the safe state" in done.result.reason or "no sample for" in done.result.reason
    assert [outcome for _, outcome in done.records] == (
        [] if not inside else ["tripped"] if "no sample" in done.result.reason else ["lost"]
    )
    assert stand.on_after(5.0) == []
    assert verify(done.result.folder).good


MOVES = """\
steps:
  - wait: 4.9 s
  - repeat: 30
    do:
      - extend: {for: 60 ms}
      - retract: {for: 60 ms}
"""


@pytest.mark.parametrize("begin", [5.1985, 5.2, 5.201, 5.22, 5.25, 5.262, 5.29, 5.313])
@pytest.mark.parametrize("kind", ["simulated", EMULATED])
def test_a_command_cut_off_by_a_loss_is_never_repeated(
    kind: str, begin: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand = Stand(kind, Workshop(tmp_path), monkeypatch)
    done = stand.run(MOVES, **lose(stand, begin, begin + 0.6))
    assert stand.is_off()
    switches = [(time, value) for time, name, value in stand.seen if name == "valve" and time > 1.0]
    pulses = [(on, off - on) for (on, value), (off, _) in pairwise(switches) if value != 0.0]
    if (
        done.result.status == "finished"
    ):  # nothing was interrupted: the waiting steps began after the loss had been assessed
        assert len(pulses) == 60
        assert [length for _, length in pulses] == pytest.approx([0.06] * 60, abs=0.002)
    else:
        assert done.result.status == "failed"
        assert "went to the safe state" in done.result.reason
        assert [on for on, _ in pulses if on > begin + 0.055] == []  # 50 ms: the solenoids' rest


def test_samples_from_before_a_record_are_not_in_it(stand: Stand) -> None:
    done = stand.run(
        "steps:\n  - repeat: 3\n    do:\n      - record: {name: r, rate: 10 Hz}\n        do: [wait: 1 s]\n"
    )
    assert done.result.status == "finished"
    run = open_run(done.result.folder)
    for index in range(3):
        record = run.record(index)
        assert record.time.size >= 9
        assert record.start <= record.time[0]
        assert record.time[-1] <= record.end
