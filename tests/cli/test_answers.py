"""The first lines of output, and progress without a terminal."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from commands import create_project, told
from rigctl.analysis.diagnosis_result import Diagnosis, Drift, Verdict
from rigctl.analysis.evidence import Evidence
from rigctl.analysis.search.identity import Levels
from rigctl.answers.blocks import Answer
from rigctl.answers.comparison import place_in_words
from rigctl.answers.diagnosis import _certain, _fits, _weighed, sentence_of
from rigctl.answers.improvement import _not_distinguished
from rigctl.answers.model.errors import error_bars
from rigctl.cli.blocks import show, show_answer
from rigctl.cli.progress import _thinned, progress_display
from rigctl.errors import RigctlError
from rigctl.model.history.change import ModelError
from rigctl.physics.families import FAMILIES


def test_counts_are_printed_at_growing_intervals_and_other_lines_at_once() -> None:
    said: list[str] = []
    time = iter(range(1000))
    tell = _thinned(said.append, lambda: float(next(time)))
    for number in range(1, 201):
        tell(f"Resampling the data: {number} of 200, about {200 - number} s left")
    tell("Fitting own")
    *counts, last = said
    assert last == "Fitting own"
    at = [int(text.split(": ")[1].split()[0]) - 1 for text in counts]
    assert at[:5] == [0, 2, 6, 14, 30]
    assert {later - earlier for earlier, later in pairwise(at[5:])} == {30}


def test_progress_goes_to_stderr_line_by_line(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_display("Beginning") as tell:
        for number in (1, 2, 3):
            tell(f"Looking: {number} of 3")
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.splitlines() == ["Looking: 1 of 3"]


def test_an_answer_is_a_summary_line_followed_by_one_line_per_fact(
    capsys: pytest.CaptureFixture[str],
) -> None:
    facts = (("size", "small"), ("how sure", "very"))
    show_answer(Answer("warn", "An effect is missing (leak)", "oil [leaks]", facts, more=("the ranking",)))
    assert [line.rstrip() for line in capsys.readouterr().out.splitlines()] == [
        "An effect is missing (leak): oil [leaks].",
        "  size        small",
        "  how sure    very",
        "  -v shows    the ranking",
    ]


def test_error_bars_show_the_error_beyond_the_noise(capsys: pytest.CaptureFixture[str]) -> None:
    noise, units = {"position": 0.127}, {"position": "mm"}
    before = ModelError({"position": 0.158}, units=units, noise=noise)
    after = ModelError({"position": 0.127}, units=units, noise=noise)
    show(error_bars([("before", before), ("with it", after)]))
    _, first, second, floor = capsys.readouterr().out.splitlines()
    assert (first.count("█"), second.count("█"), floor.count("█")) == (40, 0, 0)
    assert [line.split()[-1] for line in (first, second, floor)] == ["0.158", "0.127", "0.127"]


def test_additions_that_other_effects_could_replace_are_stated_once() -> None:
    ambiguous: Any = SimpleNamespace(
        verdict=Verdict.AMBIGUOUS,
        effects=("friction", "leak"),
        classes=(("friction", "load"), ("leak", "gain", "lag")),
    )
    clear: Any = SimpleNamespace(verdict=Verdict.MISSING_EFFECT, effects=("lag",), classes=(("lag",),))
    steps: list[Any] = [SimpleNamespace(diagnosis=one) for one in (ambiguous, ambiguous, clear)]
    text = "these data cannot distinguish friction from load, nor leak from gain or lag"
    assert _not_distinguished(steps) == text
    alone: Any = SimpleNamespace(
        verdict=Verdict.AMBIGUOUS, doubt="", effects=("friction",), classes=(("friction", "load", "lag"),)
    )
    other: Any = SimpleNamespace(
        verdict=Verdict.AMBIGUOUS, doubt="", effects=("leak",), classes=(("leak", "gain", "lag"),)
    )
    both: list[Any] = [SimpleNamespace(diagnosis=one) for one in (alone, other)]
    said = "these data cannot distinguish friction from load or lag"
    assert _not_distinguished(both) == f"{said}; these data cannot distinguish leak from gain or lag"
    assert sentence_of(alone, others_follow=False) == f"something is missing, and {said}"
    assert sentence_of(alone).endswith("cannot tell which of 3 effects it is")
    assert _not_distinguished(steps[2:]) == ""


@pytest.mark.parametrize(
    ("slot", "words"),
    [
        ("flow_a_to_b", "past the piston, from cap side to rod side (flow_a_to_b)"),
        (
            "friction + load",
            "of the piston and rod, against the motion, of what the rod pushes, against extension",
        ),
        ("unnamed", "unnamed"),  # a user's own slot without a meaning
    ],
)
def test_a_place_stands_in_words_before_its_name(slot: str, words: str) -> None:
    assert place_in_words(slot, FAMILIES["hydraulic_cylinder"]) == words


def test_the_answer_states_what_is_certain_of_each_effect() -> None:
    def levels(effect: str, *, place: bool = True, driver: bool = True, law: bool = False) -> Levels:
        return Levels(effect, (effect,), ("velocity",), place_sure=place, driver_sure=driver, law_sure=law)

    def certain(*found: Levels) -> str:
        return _certain(cast("Diagnosis", SimpleNamespace(levels=found)))

    friction, leak = levels("friction"), levels("leak", place=False, driver=False)
    assert certain() == certain(levels("friction", law=True)) == ""
    assert certain(friction) == "location and variables, a term at friction over velocity"
    assert certain(levels("friction", driver=False)) == "location, a term at friction"
    constant = Levels("load", ("load",), (), place_sure=True, driver_sure=True, law_sure=False)
    assert certain(constant) == "location, a constant term at load"
    assert certain(leak) == certain(leak, leak) == "nothing"
    assert certain(friction, leak) == (
        "friction: location and variables, a term at friction over velocity; leak: nothing"
    )


def test_all_evidence_but_the_drifts_of_the_table_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    """What is certain was neither for nor against an effect, and was missing from the answer with -v."""
    levels = Levels("friction", ("friction",), (), place_sure=True, driver_sure=True, law_sure=False)
    evidence = (
        Evidence("", ("friction",), "levels", finding=levels),
        Evidence("for", ("friction",), "mbic", -12.0),
        Evidence("", (), "drift", 20.0, 40.0, Drift("mass", 40.0, 20.0, "kg", 0.1, 0.1)),
    )
    diagnosis = cast("Diagnosis", SimpleNamespace(further_evidence=evidence))
    show([_weighed(diagnosis, adequate=False)])
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert lines == [
        "+ for friction: mBIC falls by 12.0 with it (9.2 is odds of 100 to 1)",
        "Certain is the location, a constant term at friction, but not its law",
    ]


def test_a_diagnosis_that_adds_no_effect_states_one_error() -> None:
    before, best = SimpleNamespace(fit="fit"), SimpleNamespace(fit="fit", candidates=())
    found: Any = SimpleNamespace(before=before, best=best)
    assert _fits(found) == ["fit"]


def test_an_interrupted_survey_without_reuse_has_kept_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    create_project(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rigctl.cli.commands.survey._opened", interrupt)
    command = ("survey", "--model", "models/hl32-textbook.yaml")
    with pytest.raises(RigctlError, match="what has been read is kept"):
        told(*command)
    with pytest.raises(RigctlError, match="nothing was saved"):
        told(*command, "--no-cache")
