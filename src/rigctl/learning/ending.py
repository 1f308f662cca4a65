"""Why `rigctl learn` makes no further round, and the heading for it."""

from __future__ import annotations

from enum import StrEnum


class LearningEnd(StrEnum):
    """Why there was no further round."""

    ADEQUATE = "adequate"  #: the model agrees, and each effect in it is distinguished from its rivals
    NOT_SEPARABLE = "not_separable"  #: no record on this bench would distinguish the remaining explanations
    OUTSIDE_LIBRARY = (
        "outside_library"  #: something is missing, and no effect of the library is certain to be it
    )
    NOT_DECIDED = "not_decided"  #: these data cannot tell whether anything is missing
    BUDGET = "budget"  #: the next records need more bench time than is left
    ROUNDS = "rounds"  #: the allowed number of rounds has been made
    DECLINED = "declined"  #: the user declined; the proposal is stored
    STOPPED = "stopped"  #: a run did not finish; it ended safely, and learning can continue

    @property
    def heading(self) -> str:
        """The ending as a short heading for the terminal and the page."""
        return _HEADINGS[self]


_HEADINGS = {
    LearningEnd.ADEQUATE: "Learnt",
    LearningEnd.NOT_SEPARABLE: "Not distinguishable on this bench",
    LearningEnd.OUTSIDE_LIBRARY: "Outside the library",
    LearningEnd.NOT_DECIDED: "Not decided",
    LearningEnd.BUDGET: "Out of time",
    LearningEnd.ROUNDS: "Out of rounds",
    LearningEnd.DECLINED: "Declined",
    LearningEnd.STOPPED: "Stopped",
}
