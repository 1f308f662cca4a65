"""Errors between the host and a bench."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from datetime import datetime

from rigctl.errors import ExitCode, Location, RigctlError


class BackendLost(RigctlError):
    """The bench cannot be reached, and could not be reconnected within the time allowed."""

    def __init__(
        self,
        what: str,
        *,
        value: str | None = None,
        expected: str | None = None,
        hint: str | None = None,
        where: Location | None = None,
    ) -> None:
        super().__init__(
            what, value=value, expected=expected, hint=hint, where=where, exit_code=ExitCode.FAILED
        )


class OutputsNotSafe(BackendLost):
    """The bench has not confirmed that its outputs are safe.

    `outputs` are those that may be on as far as the bench knows, with the SI values that they may have.
    `unseen_since` is the calendar time of the last contact, if a restart may since have switched on any other
    output; None otherwise. `confirmed` are outputs that are safe all the same: those of other devices.
    """

    def __init__(
        self,
        what: str,
        outputs: Mapping[str, float],
        unseen_since: datetime | None = None,
        confirmed: Collection[str] = (),
    ) -> None:
        super().__init__(what)
        self.outputs = dict(outputs)
        self.unseen_since = unseen_since
        self.confirmed = frozenset(confirmed)


class OutOfReach(BackendLost):
    """Contact is temporarily lost and is being restored; the request will not be repeated.

    The caller decides how to continue once the bench is back; its outputs are then in their safe state.
    """


class BenchTripped(RigctlError):
    """The bench has tripped, and the trip must be cleared deliberately; its outputs are safe."""

    def __init__(self, causes: str) -> None:
        self.causes = causes
        super().__init__(
            f"the board has tripped: {causes}",
            hint="Remove the cause, then clear the trip: 'rigctl off --clear-trips'",
            exit_code=ExitCode.FAILED,
        )
