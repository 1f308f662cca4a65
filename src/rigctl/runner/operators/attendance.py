"""The bound on a wait for a person who is no longer there, while outputs are on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rigctl.plan.outcomes import Outcome, StepFailed
from rigctl.planning.outline import clock_time

if TYPE_CHECKING:
    from rigctl.runner.bench import Bench

#: s of bench time after which it is logged that nobody is there: a page that is reloaded takes less
_NOTICED: Final = 5.0


class Attendance:
    """Counts for how long one wait, of a question or a pause, has been unattended with outputs on.

    Nothing else bounds such a wait: a question has no timeout, and a pause whose outputs could not be made
    safe continues. Someone at the terminal or the page decides that for himself. With nobody there, the
    outputs would stay on until somebody happens to come by.

    Time is counted from the moment at which nobody is there, and starts anew when somebody comes back or all
    outputs have their safe values.
    """

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._since: float | None = None  # s of bench time
        self._noticed = False

    def check(self, wait: str) -> None:
        """Call this regularly during the wait; `wait` describes it: ``nobody has answered 'Ready?'``.

        Raises
        ------
        StepFailed
            the wait has been unattended for the rig's `unattended_for`.
        """
        bench = self._bench
        if bench.operator.present or not bench.driven:
            if self._noticed and bench.operator.present:
                bench.event("operator", "somebody is there again", by="rigctl")
            self._since, self._noticed = None, False
            return
        if self._since is None:
            self._since = bench.now
        alone, bound = bench.now - self._since, bench.rig.unattended_for
        if alone >= bound:
            text = f"{wait}, and nobody was there for {clock_time(bound)}, with {bench.switched_on}"
            raise StepFailed(text, outcome=Outcome.TIMED_OUT)
        if not self._noticed and alone >= min(_NOTICED, 0.5 * bound):
            self._noticed = True
            rest = f"the run ends in {clock_time(bound - alone)} unless somebody returns"
            bench.event("operator", f"nobody is there, with {bench.switched_on}: {rest}", by="rigctl")
