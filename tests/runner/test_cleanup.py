"""Every ending has the same cleanup: outputs safe first, cleanup blocks, safe again, data closed."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from typing import Any

import pytest

from rigctl.backends.protocol import Sample
from rigctl.clock import VirtualClock
from rigctl.dataset import RunWriter
from rigctl.dataset.run import open_run
from rigctl.errors import ExitCode
from rigctl.runner.operators.requests import Request
from run_workshop import ScriptedControl

Do = Callable[..., Any]

NESTED = """\
steps:
  - do:
      - do:
          - set: {{heater: on}}
          - {step}
          - wait: 9 s
        finally:
          - prompt: inner finally
      - wait: 8 s
    on_failure:
      - prompt: outer on_failure
    on_abort:
      - prompt: outer on_abort
    finally:
      - prompt: outer finally
  - wait: 7 s
on_failure:
  - prompt: last on_failure
on_abort:
  - prompt: last on_abort
finally:
  - prompt: last finally
"""
FAILS = "wait: {until: position > 100 mm, timeout: 1 s}"


def asked(done: Any) -> list[str]:
    return [e["message"] for e in done.events("operator") if e.get("by") == "rigctl"]


def test_a_successful_run_executes_only_the_finally_blocks(do: Do) -> None:
    done = do(NESTED.format(step="wait: 1 s"))
    assert done.result.status == "finished"
    assert asked(done) == ["inner finally", "outer finally", "last finally"]
    assert done.states == ["arming", "running", "finishing", "finished"]


def test_an_output_left_on_by_a_step_is_off_after_a_successful_run(do: Do) -> None:
    done = do("steps:\n  - set: {heater: on}\n  - wait: 1 s\n")
    assert done.result.status == "finished"
    assert [value for _, value in done.commands("heater")] == [1.0, 0.0]


def test_a_failure_makes_outputs_safe_and_then_runs_all_cleanup_blocks(do: Do) -> None:
    done = do(NESTED.format(step=FAILS))
    assert done.result.status == "failed"
    assert done.result.exit_code is ExitCode.FAILED
    assert asked(done) == [
        "inner finally",
        "outer on_failure",
        "outer finally",
        "last on_failure",
        "last finally",
    ]
    assert done.states == ["arming", "running", "safe", "finishing", "failed"]
    kinds = [(e["kind"], e.get("message")) for e in done.log]
    heater_off = max(i for i, e in enumerate(done.log) if e["kind"] == "command" and e["value"] == 0.0)
    assert heater_off < kinds.index(("operator", "inner finally"))


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("SIGINT", ExitCode.INTERRUPTED),
        ("SIGTERM", ExitCode.TERMINATED),
        ("SIGBREAK" if sys.platform == "win32" else "SIGHUP", ExitCode.TERMINATED),
    ],
)
def test_a_signal_makes_outputs_safe_and_runs_the_on_abort_blocks(do: Do, name: str, code: ExitCode) -> None:
    number = getattr(signal, name)
    fired: list[float] = []

    def at_half_a_second(view: Any) -> None:
        if view.time > 0.5 and not fired:
            fired.append(view.time)
            signal.raise_signal(number)

    before = signal.getsignal(number)
    done = do(NESTED.format(step="wait: 5 s"), observer=at_half_a_second)
    assert signal.getsignal(number) is before
    assert (done.result.status, done.result.exit_code) == ("aborted", code)
    assert asked(done) == [
        "inner finally",
        "outer on_abort",
        "outer finally",
        "last on_abort",
        "last finally",
    ]
    assert done.commands("heater") == [(pytest.approx(0.2), 1.0), (pytest.approx(fired[0], abs=0.15), 0.0)]
    assert open_run(done.result.folder).info["status"] == "aborted"


def test_a_second_signal_skips_the_cleanup_blocks(do: Do) -> None:
    def impatient(view: Any) -> None:
        if view.time > 0.5:
            signal.raise_signal(signal.SIGINT)

    done = do(
        NESTED.format(step="wait: 5 s").replace("prompt: inner finally", "wait: 40 s"), observer=impatient
    )
    assert (done.result.status, done.result.exit_code) == ("aborted", ExitCode.INTERRUPTED)
    assert asked(done) == []
    assert done.result.duration < 2.0
    assert done.commands("heater")[-1][1] == 0.0


def test_an_abort_from_another_terminal_is_acknowledged(do: Do) -> None:
    control = ScriptedControl([(0.5, Request.ABORT), (0.6, Request.PAUSE)])
    steps = NESTED.format(step="wait: 5 s").replace("prompt: last finally", "wait: 2 s")
    done = do(steps, control=control)
    assert (done.result.status, done.result.exit_code) == ("aborted", ExitCode.INTERRUPTED)
    assert "outputs are safe" in control.answers[0]
    assert "ending already" in control.answers[1]
    assert control.views[-1].state == "aborted"


def test_a_failing_cleanup_step_does_not_stop_the_next(do: Do) -> None:
    steps = f"""\
steps:
  - {FAILS}
finally:
  - {FAILS}
  - prompt: still here
"""
    done = do(steps)
    assert asked(done) == ["still here"]
    assert any("cleanup step failed" in text for text in done.messages("note"))


def test_a_cleanup_step_is_bounded_in_time(do: Do) -> None:
    done = do(f"steps:\n  - {FAILS}\nfinally:\n  - wait: 3 h\n  - prompt: still here\n")
    assert asked(done) == ["still here"]
    assert done.result.duration < 70.0


def test_a_trip_during_the_cleanup_ends_it(do: Do) -> None:
    done = do(f"steps:\n  - {FAILS}\nfinally:\n  - extend: {{for: 5 s}}\n  - prompt: never\n")
    assert asked(done) == []
    assert "did not come true" in done.result.reason
    assert done.commands("valve")[-1][1] == 0.0
    assert "cleanup step left out: " in "".join(done.messages("note"))


def test_a_tripped_interlock_stops_the_run_before_the_next_step(do: Do) -> None:
    steps = "steps:\n  - extend: {for: 5 s}\n  - prompt: never\nfinally:\n  - retract: {for: 1 s}\n"
    done = do(steps)
    assert done.result.status == "failed"
    assert "position is 2" in done.result.reason
    assert "above the limit of 240 mm" in done.result.reason
    assert asked(done) == []
    trip = next(e["time"] for e in done.events("alarm"))
    assert [value for _, value in done.commands("valve")] == [1.0, 0.0, -1.0, 0.0]
    assert done.commands("valve")[1][0] == pytest.approx(trip, abs=1e-6)
    assert done.outcome("extend") == "tripped"


def test_cleanup_that_drives_towards_the_limit_that_stopped_the_run_is_stopped_too(do: Do) -> None:
    """The rod is at its limit of travel, and cleanup would hold it there for 40 s."""
    steps = "steps:\n  - extend: {for: 5 s}\nfinally:\n  - extend: {for: 40 s}\n  - prompt: never\n"
    done = do(steps)
    assert asked(done) == []
    assert [value for _, value in done.commands("valve")] == [1.0, 0.0, 1.0, 0.0]
    (_, _, (opened, _), (closed, _)) = done.commands("valve")
    assert closed - opened == pytest.approx(10.0, abs=0.5)
    assert "does not return while an output is on again" in "".join(done.messages("alarm"))


def test_an_exceeded_limit_prevents_arming(do: Do, workshop: Any) -> None:
    rig = workshop.rig("position: 0 mm}", "position: 250 mm}")
    done = do("steps:\n  - extend: {for: 1 s}\n", rig=rig)
    assert done.result.status == "failed"
    assert "not armed: The piston is about to reach its end stop" in done.result.reason
    assert {value for _, value in done.commands("valve")} <= {0.0}
    assert "running" not in done.states


def test_a_dry_run_reads_and_moves_nothing(do: Do) -> None:
    done = do(NESTED.format(step="wait: 1 s"), dry=True)
    assert done.result.status == "finished"
    assert done.events("command") == []
    assert len(open_run(done.result.folder).samples()) == 3


class Unclosable:
    """A backend that fails when it is closed."""

    def __init__(self, backend: Any) -> None:
        self._backend = backend

    def __getattr__(self, name: str) -> Any:
        return getattr(self._backend, name)

    def close(self) -> None:
        raise OSError("the port is gone")


class Unwritable:
    """A recorder that fails when it is closed."""

    def __init__(self, writer: Any) -> None:
        self._writer = writer

    def __getattr__(self, name: str) -> Any:
        return getattr(self._writer, name)

    def close(self, *facts: Any) -> None:
        raise ValueError("no such column")


def test_a_bench_that_cannot_be_closed_leaves_no_run_open(do: Do, workshop: Any) -> None:
    done = do("steps:\n  - wait: 1 s\n", backend=Unclosable(workshop.backend(workshop.rig())))
    assert done.result.status == "finished"
    assert open_run(done.result.folder).info["status"] == "finished"
    assert "the port is gone" in "".join(done.messages("fault"))


def test_data_that_cannot_be_closed_are_reported_without_a_traceback(do: Do, workshop: Any) -> None:
    plan = workshop.plan("steps:\n  - wait: 1 s\n")
    backend = workshop.backend(plan.rig)
    writer = RunWriter.create(workshop.folder / "runs", workshop.header(plan, backend))
    done = do("steps:\n  - wait: 1 s\n", backend=backend, writer=Unwritable(writer))
    assert (done.result.status, done.result.exit_code) == ("failed", ExitCode.FAILED)
    assert "the data could not be closed: ValueError('no such column')" in str(done.result.reason)
    writer.close("failed", done.result.reason, None)


class Faulty:
    """A backend that raises the given error at the first sample after `when`."""

    def __init__(self, backend: Any, when: float, error: Exception) -> None:
        self._backend, self._when, self._error = backend, when, error

    def __getattr__(self, name: str) -> Any:
        return getattr(self._backend, name)

    def next_sample(self, timeout: float) -> Sample | None:
        if self._backend.clock.now() > self._when:
            self._when = float("inf")
            raise self._error
        sample: Sample | None = self._backend.next_sample(timeout)
        return sample


def test_an_internal_error_ends_a_run_safely_with_its_cleanup(do: Do, workshop: Any) -> None:
    backend = Faulty(workshop.backend(workshop.rig()), 0.5, ZeroDivisionError("a bug"))
    done = do(NESTED.format(step="wait: 5 s"), backend=backend)
    assert done.result.status == "failed"
    assert "an error in rigctl: ZeroDivisionError('a bug')" in done.result.reason
    assert asked(done) == [
        "inner finally",
        "outer on_failure",
        "outer finally",
        "last on_failure",
        "last finally",
    ]
    assert "Traceback" in done.events("fault")[0]["trace"]
    assert done.commands("heater")[-1][1] == 0.0


def test_a_display_that_fails_does_not_end_the_run(do: Do) -> None:
    def broken(_: Any) -> None:
        raise RuntimeError("no terminal")

    done = do("steps:\n  - wait: 1 s\n", observer=broken)
    assert done.result.status == "finished"
    assert len([text for text in done.messages("note") if "display failed" in text]) == 1


class Mute:
    """A bench that neither reports its outputs nor answers their commands."""

    outputs_read: frozenset[str] = frozenset()
    outputs_answered: frozenset[str] = frozenset()

    def __init__(self, inner: Any) -> None:
        self.inner = inner

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)


@pytest.mark.parametrize(
    ("steps", "status", "unconfirmed"),
    [
        ("set: {heater: on}\n  - wait: 1 s", "failed", "heater on"),
        (f"set: {{heater: on}}\n  - {FAILS}", "failed", "heater on"),
        ("wait: 1 s", "finished", None),
    ],
)
def test_a_run_that_cannot_confirm_its_outputs_safe_has_not_finished(
    workshop: Any, steps: str, status: str, unconfirmed: str | None
) -> None:
    """Whatever its steps did; only what the run has driven is in doubt."""
    bench = Mute(workshop.backend(workshop.rig(), VirtualClock()))
    done = workshop.run(f"steps:\n  - {steps}\n", backend=bench)
    assert (done.result.status, done.result.unconfirmed) == (status, unconfirmed)
    assert open_run(done.result.folder).info["status"] == status
    assert done.states[-1] == status
    if unconfirmed is not None:
        assert done.result.exit_code is ExitCode.FAILED
        assert (
            "OUTPUTS NOT CONFIRMED SAFE: heater on may still be on: switch it off by hand"
            in done.result.reason
        )
