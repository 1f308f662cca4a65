"""When is a search for a formula worthwhile? If something is missing and no effect is certain to be it.

The gate is closed if the model agrees, if these data cannot tell, if a sensor reads wrongly, if the library
has an answer, or if records of one condition differ from each other, which no term of the model's variables
explains.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rigctl.analysis.agreement.replicates import replicate_test
from rigctl.analysis.comparison_result import ModelComparison
from rigctl.analysis.decision_levels import ALPHA
from rigctl.analysis.diagnosis_result import Diagnosis, Verdict
from rigctl.notebook import worded
from rigctl.wording import chance_text

#: the gate is closed if more than this share of the misfit differs between records of one condition
_IRREPRODUCIBLE = 0.5


@dataclass(frozen=True)
class Gate:
    """Whether to search, and why or why not.

    Attributes
    ----------
    reason: ``outside_library`` if it is open; ``adequate``, ``undecided``, ``sensor``, ``library`` or
        ``replicates``.
    sentence: in words; `head` a few words before it, where no search was made.
    """

    open: bool
    reason: str
    sentence: str
    head: str = ""

    @property
    def statement(self) -> str:
        """Head and sentence."""
        return f"{self.head}: {self.sentence}" if self.head else self.sentence

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {"open": self.open, "reason": self.reason, "statement": self.statement}


_NONE = "No search was made"
_OPEN = Gate(
    True,
    "outside_library",
    "Something is missing, and no effect of the library explains it with certainty, in any shape of its law",
)


def gate_of(diagnosis: Diagnosis) -> Gate:
    """The gate of a diagnosed model."""
    before = diagnosis.before
    if diagnosis.verdict in (Verdict.ADEQUATE, Verdict.UNDECIDED):
        return _of_agreement(diagnosis)
    if diagnosis.doubt:
        head = f"{_NONE}, because these data cannot tell whether anything is missing"
        return Gate(False, "undecided", worded(diagnosis, "verdict.doubt_text"), head)
    if before.adequacy.only_misread and not diagnosis.effects:
        return Gate(False, "sensor", diagnosis.statement, _NONE)
    if diagnosis.verdict is Verdict.MISSING_EFFECT or (
        diagnosis.verdict is Verdict.AMBIGUOUS and (diagnosis.indistinguishable or _sure(diagnosis))
    ):
        return Gate(False, "library", *_library(diagnosis))
    if differ := _replicates_differ(before):
        return Gate(False, "replicates", differ, _NONE)
    return _OPEN


def _of_agreement(diagnosis: Diagnosis) -> Gate:
    before = diagnosis.before
    if before.adequacy.below_noise:
        return Gate(False, "undecided", before.statement, _NONE)
    return Gate(False, "adequate", diagnosis.statement, "There is nothing to discover")


def _sure(diagnosis: Diagnosis) -> bool:
    """Whether a class of effects is certain; if not, the nearest fails cross-validation, or is unusual."""
    return any(one.place_sure for one in diagnosis.levels)


def _library(diagnosis: Diagnosis) -> tuple[str, str]:
    """The sentence and its head where the library has the answer, or a part of it."""
    names = " and ".join(diagnosis.effects)
    if besides := diagnosis.certain_besides:
        return (
            f"{besides[0]} is missing with certainty (except for its law), and so is something else: add "
            f"{besides[0]} ('rigctl model add'), then search for the rest",
            f"{_NONE} yet",
        )
    if diagnosis.verdict is Verdict.AMBIGUOUS:
        others = sorted({name for group in diagnosis.classes for name in group} - set(diagnosis.effects))
        which = f" (or {', '.join(others)})" if others else ""
        return (
            f"{names}{which} of the library would explain it, and these data do not show which of these it "
            "is: 'rigctl diagnose' says what would distinguish them",
            _NONE,
        )
    if diagnosis.remainder is not None:
        return (
            f"{names} is certainly missing, but that is not all: add it ('rigctl diagnose … --apply'), then "
            "search for the rest",
            f"{_NONE} yet",
        )
    return f"the library contains it, {names}: 'rigctl diagnose … --apply' adds it", _NONE


def _replicates_differ(before: ModelComparison) -> str:
    """The sentence that records of one condition differ by more than noise and by most of the misfit; or "":
    no term of the model's variables explains such differences."""
    tested = replicate_test(before.linearisation, before.projected.noise_degrees)
    if tested is None or tested.p_value >= ALPHA or tested.share < _IRREPRODUCIBLE:
        return ""
    return (
        "differences between records of one condition account for "
        f"{100 * tested.share:.0f} % of what the model leaves ({chance_text(tested.p_value)}): something "
        "changes from record to record that no variable of the model describes. Find out what, or record it"
    )
