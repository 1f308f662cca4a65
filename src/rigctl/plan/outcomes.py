"""The possible outcomes of a step, a record and a run."""

from __future__ import annotations

from enum import Enum

from rigctl.errors import ExitCode, Location


class Outcome(Enum):
    """The outcome of one step or one record."""

    COMPLETE = "complete"  #: it did what was required
    MISSED = "missed"  #: it was completed, and a measured value was outside its limits
    SKIPPED = "skipped"  #: it was completed in an earlier session of the run, or not executed in a dry run
    TIMED_OUT = "timed_out"  #: its condition was not met in time
    FAILED = "failed"  #: it could not be completed, or the monitored channel left its tolerance
    TRIPPED = "tripped"  #: an interlock stopped the run during it
    INTERRUPTED = "interrupted"  #: samples were lost during it; it is repeated if the procedure requests that
    LOST = "lost"  #: the bench stopped answering, or its data could not be stored
    ABORTED = "aborted"  #: the run was ended by a key, a command or a signal


class Ending(Exception):
    """Something that ends the step in progress and propagates through the enclosing groups.

    Parameters
    ----------
    outcome: outcome of the step in progress.
    reason: one sentence for the user.
    where: the step's location in the procedure file, if one step is the cause.
    exit_code: exit code of the process.
    """

    outcome = Outcome.FAILED

    def __init__(
        self,
        reason: str,
        *,
        outcome: Outcome | None = None,
        where: Location | None = None,
        exit_code: ExitCode = ExitCode.FAILED,
    ) -> None:
        super().__init__(reason)
        self.reason = reason
        self.outcome = outcome or type(self).outcome
        self.where = where
        self.exit_code = exit_code

    @property
    def aborted(self) -> bool:
        """True if a person ended the run: `on_abort` blocks run instead of `on_failure` ones."""
        return self.outcome is Outcome.ABORTED


class StepFailed(Ending):
    """A step could not be completed; `on_failure` blocks run."""


class Tripped(Ending):
    """An interlock has stopped the run; the outputs are already safe."""

    outcome = Outcome.TRIPPED


class Lost(Ending):
    """The bench no longer answers, or the data can no longer be written."""

    outcome = Outcome.LOST


class Aborted(Ending):
    """A person or the operating system has requested the end of the run; the outputs are already safe."""

    outcome = Outcome.ABORTED


class SamplesLost(Ending):
    """Samples were lost during a record, which is therefore incomplete."""

    outcome = Outcome.INTERRUPTED


class DeviceBack(SamplesLost):
    """A device was lost during a record, and is back: the record is measured again."""
