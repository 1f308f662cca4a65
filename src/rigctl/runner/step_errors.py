"""The ending that an error inside a step leads to."""

from __future__ import annotations

from traceback import format_exception

from rigctl.backends.errors import BackendLost
from rigctl.errors import ExitCode, RigctlError
from rigctl.plan.outcomes import Ending, Lost, StepFailed
from rigctl.runner.bench import Bench


def ending_for(error: Exception, bench: Bench) -> Ending:
    """The ending for an error; an error of rigctl itself is logged with its traceback."""
    if isinstance(error, Ending):
        return error
    # Before its base class: a lost bench leaves cleanup steps out, a step that failed does not.
    if isinstance(error, BackendLost):
        return Lost(str(error))
    # The call was right, since the plan was made: an exit code for wrong usage would blame the user.
    if isinstance(error, RigctlError):
        code = error.exit_code
        return StepFailed(str(error), exit_code=ExitCode.FAILED if code is ExitCode.USAGE else code)
    # Anything else is a bug. The user gets one sentence, the log what is needed to find it.
    trace = "".join(format_exception(error))
    bench.event("fault", f"an error in rigctl: {error!r}", trace=trace)
    return StepFailed(f"an error in rigctl: {error!r}; its trace is in the run's log")
