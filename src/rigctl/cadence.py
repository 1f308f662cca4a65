"""What happens once in a period, at moments that come a little early or late: loops, and slow queries.

See docs/decisions/0206-a-loop-is-updated-at-the-readings-nearest-to-its-period.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

#: fraction of the period by which it may be early, since times on a grid are rounded
EARLY = 0.01
_ROUNDING = 1e-9


@dataclass
class Cadence:
    """Choose the moments nearest to the multiples of a period.

    Readings of a device that is asked for them come a little early or late, each by itself. A loop that
    waited for a whole period since its last update would find every reading that follows a late one too
    early, and leave it out, so that the output would stand still for two periods. Hence due times are those
    of a grid, and the moment that is next to one of them counts, however late the one before was:

        |t − t_due| < T_s / 2,   t_due ← t_due + T

    After a gap the grid begins anew at the next moment: nothing is made up for.

    Parameters
    ----------
    period: T, s.
    shortest: the shortest time between two of the chosen moments, s, such as that between two commands of an
        actuator.
    """

    period: float
    shortest: float = 0.0
    _due: float = -math.inf
    _last: float = -math.inf

    def is_due(self, time: float, spacing: float) -> bool:
        """Return whether the moment `time`, s, is one of those, and remember it.

        One moment comes every `spacing` T_s, s.
        """
        # One may be late by this and the next one early: the shortest time between two holds then, too, but
        # for the rounding of the times of a grid.
        near = max(0.5 * min(spacing, self.period - self.shortest), EARLY * self.period)
        near *= 1.0 + _ROUNDING  # of two moments that are equally near it is the first
        # Rows of other devices repeat a reading: it counts once.
        if time < self._due - near or time <= self._last:
            return False
        self._last = time
        self._due = (self._due if time < self._due + near else time) + self.period
        return True
