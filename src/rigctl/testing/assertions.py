"""Assertions on a run; a failure states the actual result."""

from __future__ import annotations

import math

from rigctl.testing.run_log import RunLog


def assert_finished(run: RunLog) -> None:
    """The run was completed, and every measure lay within its limits.

    Raises
    ------
    AssertionError
        it did not; states how it ended and why.
    """
    status, code = run.result.status, int(run.result.exit_code)
    if (status, code) != ("finished", 0):
        raise AssertionError(f"the run {status}, exit code {code}: {run.result.reason}")


def assert_safe(run: RunLog) -> None:
    """The last command to each driven actuator was its safe value, and the bench confirmed it.

    Raises
    ------
    AssertionError
        it was not; names the actuator and its value.
    """
    if run.result.unconfirmed is not None:
        raise AssertionError(f"not confirmed to be safe: {run.result.unconfirmed}")
    for name, safe in run.rig.safe_state.items():
        commands = run.commands(name)
        if run.rig.actuators[name].by == "driven" and commands and commands[-1][1] != float(safe):
            time, value = commands[-1]
            shown = run.rig.actuators[name].show(value)
            raise AssertionError(f"{name} was left at {shown} at {time:g} s")


def assert_commanded(
    run: RunLog, actuator: str, *expected: tuple[float, float], tolerance: float = 1e-9
) -> None:
    """The actuator was switched to these values (SI) at these times (s), and to no others.

    Raises
    ------
    AssertionError
        it was not; states the actual commands.
    """
    found = run.commands(actuator)
    same = len(found) == len(expected) and all(
        value == wanted and math.isclose(time, at, rel_tol=0.0, abs_tol=tolerance)
        for (time, value), (at, wanted) in zip(found, expected, strict=True)
    )
    if not same:
        raise AssertionError(f"{actuator} was commanded to {found}, expected {list(expected)}")


def assert_outcome(run: RunLog, label: str, outcome: str) -> None:
    """The last step whose label begins so ended with this outcome: ``complete``, ``timed_out``, ``failed``, …

    Raises
    ------
    AssertionError
        it ended otherwise.
    """
    found = run.outcome(label)
    if found != outcome:
        raise AssertionError(f"'{label}' ended {found}, expected {outcome}: {run.result.reason}")


def assert_tripped(run: RunLog, limit: str) -> None:
    """An interlock stopped the run because of this limit of the rig.

    Raises
    ------
    AssertionError
        nothing tripped, or another limit did.
    """
    raised = [event for event in run.events("alarm") if event.get("state") == "raised"]
    stops = [event.get("name") for event in raised if event.get("action") == "stop"]
    if limit not in stops:
        raise AssertionError(f"the limit '{limit}' did not trip, but {stops}: {run.result.summary()}")
