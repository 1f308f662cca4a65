"""How a step, a record and a run may end, and what each ending means."""

from __future__ import annotations

from enum import Enum

from rigctl.errors import ExitCode, Location


class Outcome(Enum):
    """How one step or one record ended."""

    COMPLETE = "complete"  #: it did what was asked
    MISSED = "missed"  #: it was carried out, and a measured value lay outside its limits
    SKIPPED = "skipped"  #: it was done in an earlier session of the run, or a dry run moves nothing
    TIMED_OUT = "timed_out"  #: what it waited for did not come in time
    FAILED = "failed"  #: it could not be carried out, or what it watched left its tolerance
    TRIPPED = "tripped"  #: an interlock stopped the run while it was going on
    INTERRUPTED = "interrupted"  #: samples were lost inside it; it is repeated where the procedure says so
    LOST = "lost"  #: the bench stopped answering, or its data could not be kept
    ABORTED = "aborted"  #: somebody ended the run: a key, a command, a signal


class Ending(Exception):
    """Something that ends the step in progress and goes on upwards through the groups around it.

    Parameters
    ----------
    outcome: what it makes of the step in progress.
    reason: one sentence for the user.
    where: the step's place in the procedure file, when one step is to blame.
    exit_code: what the process returns in the end.
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
        """True when a person ended the run: `on_abort` blocks run, and not `on_failure` ones."""
        return self.outcome is Outcome.ABORTED


class StepFailed(Ending):
    """A step could not do what was asked; `on_failure` blocks run."""


class Tripped(Ending):
    """An interlock stopped the run; the outputs are safe already."""

    outcome = Outcome.TRIPPED


class Lost(Ending):
    """The bench does not answer any more, or the data cannot be written any more."""

    outcome = Outcome.LOST


class Aborted(Ending):
    """A person or the operating system asked for the end; the outputs are safe already."""

    outcome = Outcome.ABORTED


class SamplesLost(Ending):
    """Samples went missing inside a record: it is not whole."""

    outcome = Outcome.INTERRUPTED
