"""The JSON answer of a diagnosis."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from rigctl.analysis.agreement.adequacy import Adequacy, Test
from rigctl.analysis.conclusion import AsCompared
from rigctl.analysis.diagnosis_result import Diagnosis, Exclusion, Verdict

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "json-answers.md"
BEFORE: Any = SimpleNamespace(
    name="m",
    rows=(),
    where=(),
    trends=(),
    located=SimpleNamespace(name="m", suspicious=None),
    findings=(),
    adequate=True,
    channels=dict,
    adequacy=Adequacy({"chi2": Test(0.0, 0.5)}),
    sensors=None,
    explained_by=None,
    contradicted=False,
    rejected_if_exact=None,
    bounds=(),
    undetermined=(),
    fit=SimpleNamespace(
        solution=None,
        problem=SimpleNamespace(model=SimpleNamespace(family=SimpleNamespace(program=None))),
    ),
)


def diagnosis(excluded: tuple[Exclusion, ...]) -> Diagnosis:
    return Diagnosis(
        runs=("r",),
        model="m",
        verdict=Verdict.ADEQUATE,
        effects=(),
        classes=(),
        indistinguishable=(),
        ranking=(),
        untestable=(),
        drift=(),
        conclusion=AsCompared(),
        evidence=(),
        held_out=(),
        notes=(),
        before=BEFORE,
        best=cast("Any", None),
        trials=(),
        excluded=excluded,
    )


def test_the_json_of_an_excluded_effect_has_the_documented_fields() -> None:
    of_diagnose = PAGE.read_text(encoding="utf-8").partition("\n## diagnose\n")[2].partition("\n## ")[0]
    (row,) = re.findall(r"^\| `excluded` \|(.*)\|$", of_diagnose, re.MULTILINE)
    known: dict[str, Any] = {one.name: 4.5 for one in fields(Exclusion)}
    known |= {"effect": "piston_leakage", "only": ("20 degC",)}
    (told,) = diagnosis((Exclusion(**known),)).document()["excluded"]
    assert set(told) == set(re.findall(r"`(\w+)`", row))
    assert (told["effect"], told["only"], told["worse"]) == ("piston_leakage", ["20 degC"], 4.5)
