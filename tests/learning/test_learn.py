"""The learning loop and every way to end it; `journeys/test_learn.py` resolves a campaign with commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from rigctl.analysis.conclusion import Doubt
from rigctl.analysis.diagnosis_result import Diagnosis, Verdict
from rigctl.design.refusals import NothingLeft, NothingToSet, TooLittleTime
from rigctl.design.result import DesignResult, PrecisionGain
from rigctl.errors import ExitCode, RigctlError
from rigctl.files.shipped import shipped
from rigctl.learning import learn, predicted_and_achieved
from rigctl.learning.ending import LearningEnd
from rigctl.learning.learn import Learner
from rigctl.learning.learning_folder import LearningFolder, Task
from rigctl.plan import Plan
from rigctl.runner.session import RunResult

MODEL = shipped("models", "hl32-textbook.yaml")


def own_copy(folder: Path) -> Path:
    path = folder / "model.yaml"
    path.write_bytes(MODEL.read_bytes())
    return path


# --- every way to end, decided on prescribed analysis results ---


@dataclass
class MadeBench:
    """Measures at once; a run may be made to fail."""

    runs: Path
    status: Sequence[str] = ("finished",) * 9
    seconds: float = 600.0
    measured: list[int] = field(default_factory=list)
    vetoed: list[bool] = field(default_factory=list)  #: for each round, whether adding effects is vetoed
    precise: list[tuple[str, ...]] = field(
        default_factory=list
    )  #: the effects whose precision each design was to improve

    def plan(self, procedure: Path, arguments: Mapping[str, str]) -> Plan:
        return cast("Plan", SimpleNamespace(name=procedure.stem))

    def measure(self, plan: Plan, number: int, since: str) -> RunResult:
        status = self.status[len(self.measured)]
        self.measured.append(number)
        folder = self.runs / f"run-{len(self.measured)}"
        reason = None if status == "finished" else "an interlock tripped"
        return RunResult(status, reason, ExitCode.DONE, folder, 1, self.seconds)


class MadeDiagnosis(SimpleNamespace):
    """What learning reads of a diagnosis."""

    __class__ = Diagnosis


class MadeDesign(SimpleNamespace):
    """What learning reads of a design."""

    __class__ = DesignResult


def verdict(
    of: Verdict,
    *names: str,
    doubt: Doubt | None = None,
    unconfirmed: tuple[str, ...] = (),
    width: float = 0.05,
    instead_of_sensors: tuple[str, ...] = (),
) -> Any:
    """A diagnosis; of a model with a leak, its conductance known to `width` (95 %)."""
    fit = SimpleNamespace(errors={}, chi2_reduced=1.0, problem=SimpleNamespace(model=LEAKY), width=width)
    return MadeDiagnosis(
        model="own",
        unconfirmed=unconfirmed,
        best=SimpleNamespace(fit=fit),
        verdict=of,
        effects=names[:1],
        classes=(names,) if names else (),
        ranking=[SimpleNamespace(effect=name, probability=0.5, delta_bic=-9.0) for name in names],
        statement=of.value,
        doubt=doubt,
        instead_of_sensors=instead_of_sensors,
        before=SimpleNamespace(fit=fit),
    )


#: half widths of a leak's conductance, before a round for its precision and after
SHARPER = PrecisionGain("leak.conductance", "m^3", 3e-16, 1e-16)


def design(
    separable: bool = True,
    *,
    names: tuple[str, ...] = ("leak", "drift"),
    sharpened: Any = None,
    sensor: float = 0.9,
) -> Any:
    rivals = [SimpleNamespace(name=name, weight=1.0 / len(names)) for name in names]
    return MadeDesign(
        aim="discrimination" if sharpened is None else "precision",
        sharpened=() if sharpened is None else (sharpened,),
        separable=separable,
        sensor=None if separable else SimpleNamespace(channels=("flow",), probability=sensor),
        rivals=rivals,
        outlooks=[],
        records=[SimpleNamespace(settings={"oil": "60 degC"})],
        separation=12.0,
        after=0.9 if separable else 0.1,
        duration=500.0,
        procedure="procedure: next\n",
        statement="designed" if separable else "hardly",
    )


LEAKY = SimpleNamespace(effects={"leak": {}})
UNSURE = verdict(Verdict.AMBIGUOUS, "leak", "drift")
SURE = verdict(Verdict.ADEQUATE)
OTHER = verdict(Verdict.AMBIGUOUS, "spring", "load")
#: it has no rival, but fails cross-validation
UNCONFIRMED = verdict(Verdict.AMBIGUOUS, "leak", unconfirmed=("leak",))
CONFIRM = design(names=("leak",), sharpened=SHARPER)
#: it agrees as long as sensors may be wrong within their calibrations
SENSORS = verdict(Verdict.ADEQUATE, instead_of_sensors=("leak",))
VAGUE = verdict(Verdict.ADEQUATE, width=0.4)


@dataclass
class Stand:
    """A learner whose analysis returns prescribed results, in order."""

    learner: Learner
    bench: MadeBench
    kept: LearningFolder


@pytest.fixture
def stand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    def made(
        verdicts: Sequence[Any],
        *,
        designs: Sequence[Any] = (),
        answers: Sequence[bool] = (True,) * 9,
        status: Sequence[str] = ("finished",) * 9,
        **task: Any,
    ) -> Stand:
        said, asked = list(verdicts), list(answers)
        wanted = list(designs) or [design()] * 9

        def improved(*_: Any, **how: Any) -> Any:
            now = said[max(len(bench.measured), 1) - 1]
            bench.vetoed.append(how["unless"](now))
            return SimpleNamespace(first=now, last=now, steps=())

        def designed(*_: Any, **how: Any) -> Any:
            bench.precise.append(tuple(how["precise"]))
            one = wanted.pop(0)
            if isinstance(one, Exception):
                raise one
            return one

        monkeypatch.setattr(learn, "seconds_of", lambda _: 600.0)
        monkeypatch.setattr(learn, "compare", lambda *_, **__: None)
        monkeypatch.setattr(learn, "improve", improved)
        monkeypatch.setattr(learn, "design_experiment", designed)
        monkeypatch.setattr(
            learn,
            "gate_of",
            lambda last: SimpleNamespace(
                open=last.verdict is Verdict.OUTSIDE_LIBRARY or bool(last.unconfirmed)
            ),
        )
        monkeypatch.setattr(learn, "relative_width", lambda fit, _: fit.width)
        monkeypatch.setattr(
            predicted_and_achieved, "known_to", lambda fit, names: dict.fromkeys(names, 1e-16)
        )
        monkeypatch.setattr(learn.Learner, "_open_runs", lambda _: [])
        whole = Task("campaign.yaml", str(own_copy(tmp_path)), 1, **task)
        bench = MadeBench(tmp_path, status)
        kept = LearningFolder.create(tmp_path, whole, "campaign")
        return Stand(Learner(kept, bench, tmp_path, lambda *_: asked.pop(0)), bench, kept)

    return made


def test_learning_ends_when_the_model_is_adequate(stand: Any) -> None:
    here = stand([SURE])
    assert here.learner.learn().ended is LearningEnd.ADEQUATE
    assert here.bench.measured == [1]


def test_an_error_of_a_sensor_that_an_effect_may_explain_too_does_not_end_learning(stand: Any) -> None:
    here = stand([SENSORS, SURE])
    assert here.learner.learn().ended is LearningEnd.ADEQUATE
    assert here.bench.measured == [1, 2]


def test_rounds_continue_while_rivals_remain(stand: Any) -> None:
    here = stand([UNSURE, UNSURE, SURE])
    learned = here.learner.learn()
    assert [one.number for one in learned.rounds] == [1, 2, 3]
    assert learned.spent == 1800.0
    assert (here.kept.folder / "round-2.yaml").read_text() == "procedure: next\n"


@pytest.mark.parametrize(
    ("ended", "verdicts", "more", "statement"),
    [
        (LearningEnd.ROUNDS, [UNSURE, UNSURE], {"rounds": 2}, "2 rounds were allowed"),
        (LearningEnd.BUDGET, [UNSURE, UNSURE], {"budget": 1200.0}, "the budget is used up"),
        (
            LearningEnd.BUDGET,
            [UNSURE],
            {"designs": [TooLittleTime("too small a budget")]},
            "too small a budget",
        ),
        (LearningEnd.NOT_SEPARABLE, [UNSURE], {"designs": [NothingLeft("no", hint="two")]}, "no"),
        (LearningEnd.NOT_SEPARABLE, [UNSURE], {"designs": [design(separable=False)]}, "hardly"),
        (LearningEnd.NOT_SEPARABLE, [SENSORS], {"designs": [design(separable=False)]}, "hardly"),
        (LearningEnd.DECLINED, [UNSURE], {"answers": [False]}, "the proposal is kept in FOLDER/round-2.yaml"),
        (LearningEnd.OUTSIDE_LIBRARY, [verdict(Verdict.OUTSIDE_LIBRARY)], {}, "outside_library"),
        (
            LearningEnd.OUTSIDE_LIBRARY,
            [UNSURE, OTHER],
            {},
            "the bench behaved differently from every rival's prediction: the data point to spring",
        ),
        (
            LearningEnd.NOT_DECIDED,
            [verdict(Verdict.ADEQUATE, doubt=Doubt("within_noise"))],
            {},
            "these data cannot tell whether anything is missing: "
            "the error of every channel is within its noise",
        ),
        (
            LearningEnd.STOPPED,
            [UNSURE],
            {"status": ["finished", "failed"]},
            "the run run-2 failed: an interlock tripped",
        ),
    ],
)
def test_every_end_of_learning_states_its_reason(
    stand: Any, ended: LearningEnd, verdicts: list[Any], more: dict[str, Any], statement: str
) -> None:
    here = stand(verdicts, **more)
    learned = here.learner.learn()
    assert learned.ended is ended
    assert learned.statement == statement.replace("FOLDER", here.kept.folder.as_posix())
    assert (learned.exit_code is ExitCode.FAILED) is (ended is LearningEnd.STOPPED)
    assert (LearningFolder.find(here.kept.folder.parents[1]).learned is None) is (
        ended is LearningEnd.STOPPED
    )


def test_an_effect_that_fails_cross_validation_gets_one_more_round(stand: Any) -> None:
    """After a designed round its rival is excluded, but too few records test its prediction: more are
    measured before the answer is outside_library."""
    sure = [UNSURE, UNCONFIRMED, SURE]
    here = stand(sure, designs=[design(), CONFIRM])
    learned = here.learner.learn()
    assert learned.ended is LearningEnd.ADEQUATE
    assert here.bench.measured == [1, 2, 3]
    assert learned.rounds[2].predicted.aim == "precision"

    here = stand([UNSURE, UNCONFIRMED, UNCONFIRMED], designs=[design(), CONFIRM])
    learned = here.learner.learn()
    assert learned.ended is LearningEnd.OUTSIDE_LIBRARY  # it fails again after its one more round
    assert here.bench.measured == [1, 2, 3]

    blunt = design(names=("leak",), sharpened=replace(SHARPER, after=2.99e-16))
    assert stand([UNCONFIRMED], designs=[blunt]).learner.learn().ended is LearningEnd.OUTSIDE_LIBRARY


def test_no_effect_is_added_if_the_bench_contradicts_every_rival(stand: Any) -> None:
    """However certain the verdict: the bench may have changed, or its behaviour is not understood."""
    sure = verdict(Verdict.MISSING_EFFECT, "spring")
    here = stand([UNSURE, sure])
    assert here.learner.learn().ended is LearningEnd.OUTSIDE_LIBRARY
    assert here.bench.vetoed == [False, True]
    here = stand([UNSURE, verdict(Verdict.MISSING_EFFECT, "drift"), SURE])
    here.learner.learn()
    assert here.bench.vetoed[1] is False


def test_rounds_continue_until_the_requested_precision_is_reached(stand: Any) -> None:
    here = stand([VAGUE, VAGUE, SURE], designs=[CONFIRM, CONFIRM], precision=0.1)
    learned = here.learner.learn()
    assert learned.ended is LearningEnd.ADEQUATE
    assert here.bench.measured == [1, 2, 3]
    assert here.bench.precise == [("leak",), ("leak",)]
    last = learned.rounds[-1]
    assert last.achieved.sizes == {"leak.conductance": 1e-16}
    assert last.outcome == (
        "leak.conductance is known to within ± 1e-16 m^3 (95 %), expected ± 1e-16, before ± 3e-16"
    )
    assert stand([VAGUE]).learner.learn().ended is LearningEnd.ADEQUATE  # no precision was requested
    blunt = design(names=("leak",), sharpened=replace(SHARPER, after=2.99e-16))
    learned = stand([VAGUE], designs=[blunt], precision=0.1).learner.learn()
    assert learned.ended is LearningEnd.ADEQUATE  # no record would improve the precision


def test_without_settable_conditions_the_separating_sensor_is_named(stand: Any) -> None:
    nothing = NothingToSet("no condition of the rig 'pump' can be set", hint="With flow the records so far …")
    nothing.sensors = ("flow",)
    learned = stand([UNSURE], designs=[nothing]).learner.learn()
    assert learned.ended is LearningEnd.NOT_SEPARABLE
    assert learned.sensor == ("flow",)
    assert learned.statement == "no condition of the rig 'pump' can be set. With flow the records so far …"


def test_a_sensor_is_named_if_no_record_separates_and_the_sensor_would(stand: Any) -> None:
    learned = stand([UNSURE], designs=[design(separable=False)]).learner.learn()
    assert learned.sensor == ("flow",)
    hardly = design(separable=False, sensor=0.05)  # the best possible sensor would not separate either
    assert stand([UNSURE], designs=[hardly]).learner.learn().sensor == ()


def test_a_declined_proposal_is_kept_and_offered_again(stand: Any) -> None:
    here = stand([UNSURE, SURE], answers=[False, True])
    learned = here.learner.learn()
    assert learned.ended is LearningEnd.DECLINED
    assert Path(learned.rounds[-1].procedure).is_file()
    assert learned.rounds[-1].answer == "no"
    here.kept.reopen()
    again = here.learner.learn()
    assert again.ended is LearningEnd.ADEQUATE
    assert here.bench.measured == [1, 2]  # the first round was not carried out again
    assert Path(learned.rounds[-1].procedure).is_file()


def test_a_failed_run_is_repeated_on_resume(stand: Any) -> None:
    here = stand([UNSURE, UNSURE, SURE], status=["finished", "failed", "finished"])
    assert here.learner.learn().ended is LearningEnd.STOPPED
    assert here.learner.learn().ended is LearningEnd.ADEQUATE
    assert here.bench.measured == [1, 2, 2]
    assert here.kept.spent == 3 * 600.0


def test_the_budget_counts_bench_time_of_failed_runs(stand: Any) -> None:
    """Otherwise a bench whose runs keep failing would be tried forever."""
    verdicts, status = [UNSURE, UNSURE, UNSURE, SURE], ["finished", "failed", "failed", "finished"]
    here = stand(verdicts, status=status, budget=2000.0)
    assert here.learner.learn().ended is LearningEnd.STOPPED
    assert here.learner.learn().ended is LearningEnd.STOPPED
    learned = here.learner.learn()
    assert (learned.ended, learned.spent) == (LearningEnd.BUDGET, 1800.0)
    assert "round 2 failed, and the budget does not allow it again" in learned.statement
    assert here.bench.measured == [1, 2, 2]
    here.kept.reopen(budget=3000.0)
    assert here.learner.learn().ended is LearningEnd.ADEQUATE


@pytest.mark.parametrize("moment", range(1, 9))
def test_an_interruption_after_any_write_costs_no_run(
    stand: Any, moment: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process may end after each write to disk."""
    here = stand([UNSURE, UNSURE, SURE])
    written, times = LearningFolder.write, iter(range(1, 99))

    def write(kept: LearningFolder) -> None:
        written(kept)
        if next(times) == moment:
            raise KeyboardInterrupt

    monkeypatch.setattr(LearningFolder, "write", write)
    with pytest.raises(KeyboardInterrupt):
        here.learner.learn()
    monkeypatch.setattr(LearningFolder, "write", written)
    again = LearningFolder.find(here.kept.folder.parents[1])
    learned = Learner(again, here.bench, here.bench.runs, lambda *_: True).learn()
    assert learned.ended is LearningEnd.ADEQUATE
    assert [one.number for one in learned.rounds] == [1, 2, 3]
    assert here.bench.measured == [1, 2, 3]
    assert [one.run for one in learned.rounds] == ["run-1", "run-2", "run-3"]


def test_a_budget_below_the_first_round_is_refused_before_any_motion(stand: Any) -> None:
    here = stand([], budget=500.0)
    with pytest.raises(RigctlError, match="the budget is too small for the first round"):
        here.learner.learn()
    assert here.bench.measured == []


def test_learning_can_start_from_existing_runs(stand: Any) -> None:
    here = stand([SURE], runs=("20260101-000000-before",))
    assert here.learner.learn().ended is LearningEnd.ADEQUATE
    assert here.bench.measured == []
