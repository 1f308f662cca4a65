"""The result of `rigctl learn`, round by round: what was measured, the outcome, and what was predicted.

A `Round` is written before its records are measured, with the prediction (`PredictedRound`), and completed
afterwards (`RoundOutcome`): a prediction that were computed later could not be held against its outcome. The
words are made in `rigctl.answers`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

from rigctl.analysis.diagnosis_result import Diagnosis
from rigctl.design.result import DesignResult
from rigctl.errors import ExitCode, RigctlError
from rigctl.learning.ending import LearningEnd
from rigctl.notebook import as_html, one_line, worded
from rigctl.runner.session import RunResult

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class PredictedRound:
    """The predicted power of a designed round, as recorded before anything was measured.

    If its aim is to estimate a size better, there are no rivals to be distinguished.

    Attributes
    ----------
    rivals: names, the most probable first, with their weights.
    separation: D, the expected deviance (gain of 2·ln L).
    probability: that a verdict names the right one alone.
    outlooks: for each ordered pair (truth, rival): margin so far, D and probability.
    duration: bench time, s.
    records: what was to be measured, in words.
    aim: of the design.
    sharpened: for aim ``precision``, each parameter with its unit and the half-widths of its 95 % interval
        before and after, according to the design.
    """

    rivals: Mapping[str, float]
    separation: float
    probability: float
    outlooks: tuple[Mapping[str, Any], ...]
    duration: float
    records: tuple[str, ...]
    aim: str = "discrimination"
    sharpened: tuple[Mapping[str, Any], ...] = ()

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "weights": dict(self.rivals),
            "expected_separation": self.separation,
            "probability": self.probability,
            "outlooks": [dict(one) for one in self.outlooks],
            "duration": self.duration,
            "records": list(self.records),
            "aim": self.aim,
            "sharpened": [dict(one) for one in self.sharpened],
        }

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> PredictedRound:
        """The prediction that `document` describes."""
        return cls(
            rivals=dict(document["weights"]),
            separation=float(document["expected_separation"]),
            probability=float(document["probability"]),
            outlooks=tuple(document["outlooks"]),
            duration=float(document["duration"]),
            records=tuple(document["records"]),
            aim=document.get("aim", "discrimination"),
            sharpened=tuple(document.get("sharpened", ())),
        )


@dataclass(frozen=True)
class RoundOutcome:
    """The outcome of a predicted round.

    Attributes
    ----------
    winner: the rival that the data prefer now; "" if they prefer none of them.
    gains: for each other rival, the increase of the winner's margin over it, which D predicted.
    expected: the predicted values, if the winner is right.
    distinguished: whether the winner is distinguished from all others now.
    kept: whether the bench behaved as one of the rivals predicted; if False, `rigctl discover` is suggested.
    sizes: for a round for precision, the half-width with which each parameter is known now, in the units of
        `PredictedRound.sharpened`.
    recorded: the sentence that the session's folder keeps of it; "" before it is read from there.
    """

    winner: str
    gains: Mapping[str, float]
    expected: Mapping[str, float]
    distinguished: bool
    kept: bool
    sizes: Mapping[str, float] = field(default_factory=dict)
    recorded: str = field(default="", compare=False)

    def document(self, statement: str) -> dict[str, Any]:
        """Its machine-readable form, with the statement of its round."""
        return {
            "winner": self.winner,
            "gains": dict(self.gains),
            "expected": dict(self.expected),
            "told_apart": self.distinguished,
            "kept": self.kept,
            "statement": statement,
            "sizes": dict(self.sizes),
        }

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> RoundOutcome:
        """The outcome that `document` describes."""
        return cls(
            winner=document["winner"],
            gains=dict(document["gains"]),
            expected=dict(document["expected"]),
            distinguished=bool(document["told_apart"]),
            kept=bool(document["kept"]),
            sizes=dict(document.get("sizes", {})),
            recorded=document["statement"],
        )


@dataclass(frozen=True)
class Round:
    """One round: a procedure, its run, and the verdict on all runs so far.

    Attributes
    ----------
    number: from 1 on.
    procedure: the file that was carried out.
    run: the run's folder name; "" if nothing has been measured yet.
    duration: its bench time, s.
    lost: bench time of its runs that did not finish, s.
    verdict, effects, classes: of the diagnosis on all runs so far, before anything was added.
    probabilities: of the effects in question, by name.
    added: effects that were added because they were certain, each with the version in which it was.
    error: by channel, the normalised root mean square error with the model after the round.
    chi2: reduced, of the same fit.
    statement: of the diagnosis, in words, as the session's folder keeps it.
    predicted: the predicted power of the round; None for the first.
    achieved: the outcome.
    answer: whether the round should be carried out: ``yes``, ``no``, or "" if not yet asked.
    """

    number: int
    procedure: str
    run: str = ""
    duration: float = 0.0
    lost: float = 0.0
    verdict: str = ""
    effects: tuple[str, ...] = ()
    classes: tuple[tuple[str, ...], ...] = ()
    probabilities: Mapping[str, float] = field(default_factory=dict)
    added: tuple[tuple[str, int], ...] = ()
    error: Mapping[str, float] = field(default_factory=dict)
    chi2: float | None = None
    statement: str = ""
    predicted: PredictedRound | None = None
    achieved: RoundOutcome | None = None
    answer: str = ""

    @property
    def judged(self) -> bool:
        """Whether its run has been analysed."""
        return bool(self.verdict)

    @property
    def outcome(self) -> str:
        """What came of the prediction, in words; "" if nothing was predicted or measured."""
        return worded(self, "learning.outcome")

    def document(self) -> dict[str, Any]:
        """Its machine-readable form."""
        return {
            "round": self.number,
            "procedure": self.procedure,
            "run": self.run or None,
            "duration": self.duration,
            "lost": self.lost,
            "verdict": self.verdict or None,
            "effects": list(self.effects),
            "classes": [list(names) for names in self.classes],
            "probabilities": dict(self.probabilities),
            "added": [{"effect": name, "version": version} for name, version in self.added],
            "error": dict(self.error),
            "chi2_reduced": self.chi2,
            "statement": self.statement,
            "promised": None if self.predicted is None else self.predicted.document(),
            "came_out": None if self.achieved is None else self.achieved.document(self.outcome),
            "answer": self.answer or None,
        }

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> Round:
        """The round that `document` describes."""
        predicted, achieved = document["promised"], document["came_out"]
        return cls(
            number=int(document["round"]),
            procedure=document["procedure"],
            run=document["run"] or "",
            duration=float(document["duration"]),
            lost=float(document.get("lost", 0.0)),
            verdict=document["verdict"] or "",
            effects=tuple(document["effects"]),
            classes=tuple(tuple(names) for names in document["classes"]),
            probabilities=dict(document["probabilities"]),
            added=tuple((one["effect"], int(one["version"])) for one in document["added"]),
            error=dict(document["error"]),
            chi2=document["chi2_reduced"],
            statement=document["statement"],
            predicted=None if predicted is None else PredictedRound.read(predicted),
            achieved=None if achieved is None else RoundOutcome.read(achieved),
            answer=document["answer"] or "",
        )


#: what there was no further round for: a diagnosis, a round, a design, its refusal, or a run
Reason: TypeAlias = Diagnosis | Round | DesignResult | RigctlError | RunResult


@dataclass(frozen=True)
class Learned:
    """The result of learning.

    Attributes
    ----------
    rounds: in order; the last may be a proposal that was not carried out.
    ended: why there was no further round; `because` of what.
    model: the file whose versions were saved, and `version` the last of them.
    spent: bench time, s.
    sensor: names of channels that would distinguish what is left, if the bench as it is could not.
    exit_code: that of a run that did not finish, else 0.
    """

    rounds: tuple[Round, ...]
    ended: LearningEnd
    model: str
    version: int
    spent: float
    because: Reason = field(repr=False)
    sensor: tuple[str, ...] = ()
    exit_code: ExitCode = ExitCode.DONE

    @property
    def statement(self) -> str:
        """Why there was no further round, in words."""
        return worded(self, "learning.statement")

    @property
    def added(self) -> tuple[str, ...]:
        """Every effect that was added, in order."""
        return tuple(name for one in self.rounds for name, _ in one.added)

    @property
    def predictions(self) -> tuple[tuple[PredictedRound, RoundOutcome], ...]:
        """The prediction and the outcome of each round that was carried out."""
        return tuple((one.predicted, one.achieved) for one in self.rounds if one.predicted and one.achieved)

    def document(self) -> dict[str, Any]:
        """The machine-readable answer."""
        return {
            "ended": self.ended.value,
            "statement": self.statement,
            "model": self.model,
            "version": self.version,
            "added": list(self.added),
            "spent": self.spent,
            "sensor": list(self.sensor),
            "rounds": [one.document() for one in self.rounds],
        }

    def summary(self) -> str:
        """One line for each round, and how it ended."""
        return worded(self, "learning.summary")

    def frame(self) -> pd.DataFrame:
        """The rounds, one row for each, predicted beside actual values."""
        import pandas as pd

        return pd.DataFrame([_row(one) for one in self.rounds])

    def __repr__(self) -> str:
        """One-line representation."""
        return one_line(self, f"{len(self.rounds)} rounds, {self.ended.value}")

    def _repr_html_(self) -> str:
        """The summary and the rounds, as a notebook shows them."""
        return as_html(self.summary(), self.frame())


def _row(one: Round) -> dict[str, Any]:
    gains: Sequence[float] = () if one.achieved is None else tuple(one.achieved.gains.values())
    return {
        "round": one.number,
        "run": one.run,
        "verdict": one.verdict,
        "effects": ", ".join(one.effects),
        "added": ", ".join(name for name, _ in one.added),
        "chi2_reduced": one.chi2,
        "duration_s": one.duration,
        "D_promised": None if one.predicted is None else one.predicted.separation,
        "P_promised": None if one.predicted is None else one.predicted.probability,
        "D_came_out": min(gains, default=None),
        "told_apart": None if one.achieved is None else one.achieved.distinguished,
    }
