"""When is a search for a formula worthwhile? If something is missing and no effect is certain to be it.

The gate is closed if the model agrees, if these data cannot tell, if a sensor reads wrongly, if the library
has an answer, or if records of one condition differ from each other, which no term of the model's variables
explains.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from rigctl.analysis.agreement.replicates import ReplicateTest, replicate_test
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.decision_levels import ALPHA
from rigctl.analysis.diagnosis_result import Diagnosis, Verdict

#: the gate is closed if more than this share of the misfit differs between records of one condition
_IRREPRODUCIBLE = 0.5


#: what opened the gate, or keeps it closed
GateCause = Literal[
    "outside_library",
    "adequate",
    "below_noise",
    "doubt",
    "sensor",
    "library",
    "library_and_rest",
    "indistinguishable",
    "certain_besides",
    "replicates",
]
#: the documented reason of each cause
_REASONS: dict[GateCause, str] = {
    "below_noise": "undecided",
    "doubt": "undecided",
    "library_and_rest": "library",
    "indistinguishable": "library",
    "certain_besides": "library",
}


@dataclass(frozen=True)
class Gate:
    """Whether to search, and why or why not.

    Attributes
    ----------
    cause: what decided it.
    diagnosis: of the model, which decided it.
    replicates: the test between records of one condition, if it decided.
    """

    cause: GateCause
    diagnosis: Diagnosis = field(repr=False)
    replicates: ReplicateTest | None = None

    @property
    def open(self) -> bool:
        """Whether a search is worthwhile."""
        return self.cause == "outside_library"

    @property
    def reason(self) -> str:
        """``outside_library`` if it is open; ``adequate``, ``undecided``, ``sensor``, ``library`` or
        ``replicates``."""
        return _REASONS.get(self.cause, self.cause)


def gate_of(diagnosis: Diagnosis) -> Gate:
    """The gate of a diagnosed model."""
    tested = None
    cause = _cause(diagnosis)
    if cause == "outside_library":
        tested = _replicates_differ(diagnosis.before)
    return Gate(cause if tested is None else "replicates", diagnosis, tested)


def _cause(diagnosis: Diagnosis) -> GateCause:
    """What decides, apart from the differences between records of one condition."""
    before = diagnosis.before
    # What is more certain than a formula comes first: no misfit, an unknown noise, a sensor, an
    # effect of the library. A formula would fit any of these.
    if diagnosis.verdict in (Verdict.ADEQUATE, Verdict.UNDECIDED):
        return "below_noise" if before.adequacy.below_noise else "adequate"
    if diagnosis.doubt:
        return "doubt"
    if before.adequacy.only_misread and not diagnosis.effects:
        return "sensor"
    if diagnosis.verdict is Verdict.MISSING_EFFECT or (
        diagnosis.verdict is Verdict.AMBIGUOUS and (diagnosis.indistinguishable or _sure(diagnosis))
    ):
        return _in_library(diagnosis)
    return "outside_library"


def _in_library(diagnosis: Diagnosis) -> GateCause:
    """Whether the library has the whole answer, or a part of it."""
    if diagnosis.certain_besides:
        return "certain_besides"
    if diagnosis.verdict is Verdict.AMBIGUOUS:
        return "indistinguishable"
    return "library" if diagnosis.remainder is None else "library_and_rest"


def _sure(diagnosis: Diagnosis) -> bool:
    """Whether a class of effects is certain; if not, the nearest fails cross-validation, or is unusual."""
    return any(one.place_sure for one in diagnosis.levels)


def _replicates_differ(before: ModelComparison) -> ReplicateTest | None:
    """The test by which records of one condition differ by more than noise and by most of the misfit: no term
    of the model's variables explains such differences."""
    tested = replicate_test(before.linearisation, before.projected.noise_degrees)
    if tested is None or tested.p_value >= ALPHA or tested.share < _IRREPRODUCIBLE:
        return None
    return tested
