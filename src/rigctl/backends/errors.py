"""What goes wrong between the host and a bench."""

from __future__ import annotations

from rigctl.errors import ExitCode, Location, RigctlError


class BackendLost(RigctlError):
    """The bench cannot be reached, and trying again within the allowed time did not help."""

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


class OutOfReach(BackendLost):
    """Contact is lost for the moment and is being looked for; what was asked for will not be made up for.

    The caller decides what becomes of it once the bench is back, which leaves it in its safe state.
    """


class BenchTripped(RigctlError):
    """The bench has tripped and waits for somebody to clear that on purpose; its outputs are safe."""

    def __init__(self, causes: str) -> None:
        self.causes = causes
        super().__init__(
            f"the board has tripped: {causes}",
            hint="Remove the cause, then clear the trip: 'rigctl off --clear-trips'",
            exit_code=ExitCode.FAILED,
        )
