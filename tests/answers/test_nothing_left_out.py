"""What an answer leaves out beside the verdict is found where there is room for it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from linear_problem import PLAIN, compared, made_design
from rigctl.analysis.collected_evidence import collected_evidence
from rigctl.analysis.comparison_result import Comparison, ModelComparison
from rigctl.analysis.diagnosis import diagnose_comparison
from rigctl.analysis.diagnosis_result import Diagnosis, Verdict
from rigctl.analysis.search.judgement import Judgement
from rigctl.analysis.single_values.findings import SettingOffsets
from rigctl.answers.blocks import Answer
from rigctl.answers.comparison import comparison_answer, numbers
from rigctl.answers.design.design import rival_tables
from rigctl.answers.diagnosis import diagnosis_answer, whole_diagnosis
from rigctl.cli.blocks import show, show_answer
from rigctl.report.analysis.comparison import comparison_sections
from rigctl.report.analysis.page_top import answer_section


@pytest.fixture(scope="module")
def model() -> ModelComparison:
    """A model that lacks an effect of 30 sigma."""
    design = made_design(PLAIN, np.eye(len(PLAIN)))
    return compared(design, design.readings({"alpha.size": 30.0}, design.typical_noise()))


@pytest.fixture(scope="module")
def diagnosis(model: ModelComparison) -> Diagnosis:
    return diagnose_comparison(model)


def with_findings(model: ModelComparison, count: int) -> ModelComparison:
    located = replace(model.located)
    vars(located)["findings"] = tuple(SettingOffsets(f"V{number}", "1", ()) for number in range(count))
    return replace(model, located=located)


def page(answer: Answer) -> str:
    return str(answer_section(answer, None, about="m").body)


def printed(answer: Answer, capsys: pytest.CaptureFixture[str]) -> str:
    show_answer(answer)
    return capsys.readouterr().out


def comparison(*models: ModelComparison, held_out: Sequence[str] = ()) -> Comparison:
    return Comparison(runs=("r",), held_out=tuple(held_out), notes=(), models=models)


def test_a_page_has_every_finding_and_a_terminal_the_first_two(
    model: ModelComparison, diagnosis: Diagnosis, capsys: pytest.CaptureFixture[str]
) -> None:
    five = with_findings(model, 5)
    for answer in (comparison_answer(comparison(five)), diagnosis_answer(replace(diagnosis, before=five))):
        drawn, told = page(answer), printed(answer, capsys)
        assert all(f"The rows of each V{number} share" in drawn for number in range(5))
        assert "<summary>3 more findings</summary>" in drawn
        assert "each V1 share" in told
        assert "each V2 share" not in told
    assert "1 more finding<" in page(comparison_answer(comparison(with_findings(model, 3))))
    assert "<details>" not in page(comparison_answer(comparison(with_findings(model, 2))))


def test_what_has_to_be_known_of_an_earlier_model_is_said_with_its_name(
    model: ModelComparison, capsys: pytest.CaptureFixture[str]
) -> None:
    def bounded(name: str, text: str) -> ModelComparison:
        one = replace(model, name=name)
        vars(one)["bounds"] = (SimpleNamespace(statement=text, decisive=False),)
        return one

    models = (bounded("old", "mass is at its bound"), bounded("new", "area is at its bound"))
    told = printed(comparison_answer(comparison(*models)), capsys)
    assert "old: mass is at its bound." in told
    assert "\narea is at its bound." in told


def test_the_whole_diagnosis_says_where_the_files_of_laws_are(
    diagnosis: Diagnosis, capsys: pytest.CaptureFixture[str]
) -> None:
    law = SimpleNamespace(
        effect="alpha",
        power=None,
        differs=True,
        file=Path("effects/alpha.yaml"),
        law=SimpleNamespace(asked=np.array([np.nan]), differs=True, driver=SimpleNamespace(name="pressure")),
        assumed=np.zeros(1),
    )
    show(whole_diagnosis(replace(diagnosis, laws=cast("Any", (law,)))))
    assert "written: effects/alpha.yaml" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("verdict", "as_compared", "stated"),
    [
        (Verdict.ADEQUATE, True, True),
        (Verdict.ADEQUATE, False, False),  # shown is another comparison, with a statement of its own
        (Verdict.AMBIGUOUS, True, False),  # its statement is of effects
    ],
)
def test_record_level_evidence_is_left_out_only_if_the_statement_has_it(
    verdict: Verdict, as_compared: bool, stated: bool
) -> None:
    drifting = SimpleNamespace(evident=True)
    before = SimpleNamespace(
        adequacy=SimpleNamespace(agrees=False), record_level=(drifting,), suspicious=drifting
    )
    judged = SimpleNamespace(
        search=SimpleNamespace(before=before),
        shown=before if as_compared else SimpleNamespace(),
        verdict=verdict,
        named=False,
    )
    (evidence,) = collected_evidence(cast("Judgement", judged), {})
    assert evidence.finding is drifting
    assert evidence.stated is stated


def test_a_design_says_what_its_uncertainties_are(capsys: pytest.CaptureFixture[str]) -> None:
    sharper = SimpleNamespace(name="mass", before=2.0, after=1.0, unit="kg")
    show(rival_tables(cast("Any", SimpleNamespace(rivals=(), outlooks=(), sharpened=(sharper,)))))
    told = capsys.readouterr().out
    assert "± now (95 %)" in told
    assert "± after (95 %)" in told


def test_a_page_has_the_figures_of_every_model(model: ModelComparison) -> None:
    old, new = replace(model, name="old"), replace(model, name="new")
    labels = [f"r/{number}" for number in range(1, 9)]
    (*_, statistics) = comparison_sections(comparison(old, new, held_out=labels), answered=True)
    captions = re.findall(r"<caption>(.*?)</caption>", statistics.body)
    assert captions.count("Old") == captions.count("New") == 3  # channels, tests, record-level parameters
    assert str(statistics.body).count('<th scope="col">R²</th>') == 2
    assert "Held out: 8 records (r/1" in statistics.body
    assert "<summary>All records held out</summary>" in statistics.body
    assert "<li>r/8.</li>" in statistics.body


def test_a_page_with_another_answer_states_what_each_model_and_its_curves_leave(
    model: ModelComparison,
) -> None:
    located = replace(model.located)
    vars(located)["curve_bands"] = (
        SimpleNamespace(statement="the band of the curve fan is wide", channel="fan"),
    )
    one = comparison(replace(model, located=located))
    for answered in (True, False):
        (*_, statistics) = comparison_sections(one, answered=answered)
        assert ("The band of the curve fan is wide." in statistics.body) is answered
        assert ("does not agree with the measurements" in statistics.body) is answered


def test_one_record_is_counted_as_one(model: ModelComparison, capsys: pytest.CaptureFixture[str]) -> None:
    show(numbers(comparison(model, held_out=["r/1"])))
    assert "held out: 1 record (r/1)" in capsys.readouterr().out
