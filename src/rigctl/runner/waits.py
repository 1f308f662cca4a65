"""What a step waits for. A step is a generator that yields these; the runner alone lets time pass."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass
from enum import Enum
from typing import TypeAlias

from rigctl.runner.outcomes import Outcome

#: ``(time, record, *channels, *commands)``, SI
Row: TypeAlias = tuple[float, ...]


class OnPause(Enum):
    """What a pause does to a step that is waiting."""

    RESTART = "restart"  #: the commands it began with are restored and it begins again
    KEEP = "keep"  #: commands are restored and it goes on waiting
    DEFER = "defer"  #: the pause waits until it is over, since half of it would be worthless


@dataclass(frozen=True, slots=True)
class Until:
    """Go on at bench time `time`, or at the first sample for which `when` is true.

    The generator is then sent that sample's row, or None when the time was up.
    """

    time: float = math.inf
    when: Callable[[Row], object] | None = None
    on_pause: OnPause = OnPause.RESTART


Behaviour: TypeAlias = Generator[Until, Row | None, Outcome]
Waiting: TypeAlias = Generator[Until, Row | None, None]


def every_sample(_: Row) -> bool:
    """A condition that every sample satisfies."""
    return True


#: between two steps: look at signals, requests and the samples that are due, and go on at once
CHECKPOINT = Until(-math.inf, on_pause=OnPause.KEEP)
