"""Effects that would bring a model closer to a table, though not by more than chance does."""

from __future__ import annotations

from rigctl.compare.scores import Score, Screening

#: effects that lower the misfit by so many standard deviations are worth a word
_NOTABLE = 2.5
#: of a signature of which the fitted parameters imitate all but this share, nothing is said
_OWN = 0.05


def near_chance(screening: Screening) -> list[Score]:
    """The scores worth a word in a table that no effect explains for certain, the best first."""
    return [score for score in screening.scores if score.z > _NOTABLE and score.kappa > _OWN]
