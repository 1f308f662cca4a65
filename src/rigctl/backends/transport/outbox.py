"""What a bench has for its runner: samples, receipts and notices, kept until they are fetched."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from rigctl.backends.protocol import CommandReceipt, Notice, Sample
from rigctl.clock import Clock


class Outbox:
    """Filled by whatever reads the bench, emptied by the runner.

    Attributes
    ----------
    samples, receipts, notices: what has not been fetched yet, oldest first.
    commanded: what each actuator was last commanded to, SI; what the bench reports is entered here as well.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.samples: deque[Sample] = deque()
        self.receipts: list[CommandReceipt] = []
        self.notices: list[Notice] = []
        self.commanded: dict[str, float] = {}

    def take_receipts(self) -> list[CommandReceipt]:
        """The receipts since the last call."""
        taken, self.receipts = self.receipts, []
        return taken

    def take_notices(self) -> list[Notice]:
        """The notices since the last call."""
        taken, self.notices = self.notices, []
        return taken

    def notice(self, kind: str, message: str, *, time: float | None = None, **fields: object) -> None:
        """Something that belongs into the run's events, now unless another time is given."""
        self.notices.append(Notice(self._clock.now() if time is None else time, kind, message, fields))

    def gap(self, missing: int, *, cause: str = "", switched_off: Sequence[str] = ()) -> None:
        """Samples that will not come, and what went to its safe value meanwhile without being commanded."""
        text = f"{missing} sample{'' if missing == 1 else 's'} missing before {self._clock.now():.3f} s"
        if cause:
            text += f": {cause}"
        if not switched_off:
            self.notice("gap", text, samples=missing)
            return
        text += f"; meanwhile {', '.join(switched_off)} went to the safe state"
        self.notice("gap", text, samples=missing, switched_off=list(switched_off))
