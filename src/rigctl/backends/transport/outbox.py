"""A bench's samples, receipts and notices, stored until the runner fetches them."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from rigctl.backends.protocol import CommandReceipt, Notice, Sample
from rigctl.clock import Clock
from rigctl.wording import number_of


class Outbox:
    """A queue that is filled by the reader of the bench and emptied by the runner.

    Attributes
    ----------
    samples, receipts, notices: not yet fetched, oldest first.
    commanded: last command of each actuator, SI, including those reported by the bench.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.samples: deque[Sample] = deque()
        self.receipts: list[CommandReceipt] = []
        self.notices: list[Notice] = []
        self.commanded: dict[str, float] = {}

    def take_receipts(self) -> list[CommandReceipt]:
        """Return the receipts since the last call."""
        taken, self.receipts = self.receipts, []
        return taken

    def take_notices(self) -> list[Notice]:
        """Return the notices since the last call."""
        taken, self.notices = self.notices, []
        return taken

    def notice(self, kind: str, message: str, *, time: float | None = None, **fields: object) -> None:
        """Add a notice, with the present time unless another one is given."""
        self.notices.append(Notice(self._clock.now() if time is None else time, kind, message, fields))

    def gap(self, missing: int, *, cause: str = "", switched_off: Sequence[str] = ()) -> None:
        """Add the notice of a gap, with the actuators that went to their safe value without a command."""
        text = f"{number_of(missing, 'sample')} missing before {self._clock.now():.3f} s"
        if cause:
            text += f": {cause}"
        if not switched_off:
            self.notice("gap", text, samples=missing)
            return
        text += f"; meanwhile {', '.join(switched_off)} went to the safe state"
        self.notice("gap", text, samples=missing, switched_off=list(switched_off))
