"""Why `rigctl learn` makes no further round."""

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
