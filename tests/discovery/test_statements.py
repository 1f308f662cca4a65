"""The answers of a search that is refused, undecided, or uncertain of the location."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from rigctl.analysis.conclusion import Doubt
from rigctl.analysis.diagnosis_result import Verdict
from rigctl.analysis.linear.cross_validation import CrossValidation
from rigctl.answers.discovery import discovery_answer, gate_statement, notes, statement, too_weak
from rigctl.answers.discovery import written as written_term
from rigctl.cli.commands.discover import _suggest_next
from rigctl.command_line import DataOptions
from rigctl.discovery.gate import gate_of
from rigctl.discovery.locate import Located, Map, locate
from rigctl.discovery.result import Discovery, FoundFormula
from rigctl.effects.drivers import Driver
from rigctl.physics.families import find_family

FAMILY = find_family("hydraulic_cylinder")
VELOCITY = Driver((("velocity", 1.0),), "m/s")


def located(slot: str, statistic: float, p_value: float = 1e-4, dof: int = 8) -> Located:
    return Located(FAMILY.slot(slot), (VELOCITY,), statistic, dof, p_value, 0.5)


def diagnosed(verdict: Verdict, *, only_misread: bool = False, **changed: Any) -> Any:
    """The attributes of a diagnosis that the gate reads."""
    adequacy = SimpleNamespace(below_noise=False, only_misread=only_misread)
    lin = SimpleNamespace(records=(), regions=SimpleNamespace(groups=()))
    projected = SimpleNamespace(noise_degrees=0)
    before = SimpleNamespace(adequacy=adequacy, statement="it is so", linearisation=lin, projected=projected)
    said: dict[str, Any] = {
        "verdict": verdict,
        "before": before,
        "doubt": None,
        "effects": (),
        "classes": (),
        "indistinguishable": (),
        "levels": (),
        "certain_besides": (),
        "remainder": None,
        "statement": "these data show nothing that it lacks",
        "notes": (),
    }
    return SimpleNamespace(**(said | changed))


@pytest.mark.parametrize(
    ("verdict", "changed", "reason", "words"),
    [
        (Verdict.ADEQUATE, {}, "adequate", "nothing to discover"),
        (
            Verdict.OUTSIDE_LIBRARY,
            {"doubt": Doubt("within_noise"), "model": "m"},
            "undecided",
            "within its noise",
        ),
        (
            Verdict.OUTSIDE_LIBRARY,
            {"only_misread": True, "statement": "T1 reads wrongly"},
            "sensor",
            "T1 reads",
        ),
        (Verdict.MISSING_EFFECT, {"effects": ("barus",)}, "library", "--apply' adds it"),
        (
            Verdict.MISSING_EFFECT,
            {"effects": ("barus",), "remainder": SimpleNamespace()},
            "library",
            "that is not all",
        ),
        (
            Verdict.AMBIGUOUS,
            {
                "effects": ("barus", "hysteresis"),
                "levels": (SimpleNamespace(place_sure=True), SimpleNamespace(place_sure=False)),
                "certain_besides": ("barus",),
                "remainder": SimpleNamespace(),
            },
            "library",
            "add barus ('rigctl model add'), then search for the rest",
        ),
        (
            Verdict.AMBIGUOUS,
            {
                "effects": ("barus",),
                "classes": (("barus", "entrained_air"),),
                "indistinguishable": (("barus", "entrained_air"),),
            },
            "library",
            "entrained_air",
        ),
    ],
)
def test_a_refused_search_gives_its_reason(
    verdict: Verdict, changed: dict[str, Any], reason: str, words: str
) -> None:
    gate = gate_of(diagnosed(verdict, **changed))
    assert not gate.open
    assert gate.reason == reason
    assert words in gate_statement(gate)
    found = Discovery((), "", gate, None, (), (), 0, gate.diagnosis)
    told = discovery_answer(found)  # it was printed as "No formula: No search was made: ..."
    assert f"{told.title}: {told.sentence}" == gate_statement(gate)
    assert told.title.startswith(("No search was made", "There is nothing to discover"))


def test_the_search_starts_if_no_library_effect_is_certain() -> None:
    assert gate_of(diagnosed(Verdict.OUTSIDE_LIBRARY)).open
    # the best effect fails cross-validation: no class of effects is certain
    assert gate_of(diagnosed(Verdict.AMBIGUOUS, effects=("barus",), classes=(("barus",),))).open


def test_too_weak_evidence_states_how_many_records_would_suffice() -> None:
    said = too_weak(Map((located("friction", 24.0, 0.3),), (), 210, 56.0, 8.0))
    assert "210 terms tested" in said
    assert "friction over velocity" in said
    assert "8.0 are needed" in said
    assert "4 times as many records" in said
    assert "at any location" in too_weak(Map((), (), 0, 0.0, 8.0))


def test_a_large_but_uncertain_effect_is_not_calledtoo_weak() -> None:
    """Else the same sentence has 90 sigma where 8 are needed, and asks for 1.1 times as many records."""
    said = too_weak(Map((located("friction", 8108.0, 0.3),), (), 210, 56.0, 8.0))
    assert "90 times as strong as chance" in said
    assert "p = 0.3" in said
    assert "record more conditions" in said
    assert "too weak" not in said.casefold()
    assert "needed" not in said


@pytest.mark.parametrize(("combine", "written"), [("sum", "here + 2*x"), ("product", "here*(1 + 2*x)")])
def test_a_formula_is_written_with_its_slot_as_the_slot_combines_terms(combine: str, written: str) -> None:
    slot = SimpleNamespace(combine=combine)
    term = "2*x" if combine == "sum" else "1 + 2*x"
    found = SimpleNamespace(
        slot="here", term=term, fitted=SimpleNamespace(formula=SimpleNamespace(slot=slot))
    )
    assert written_term(cast("FoundFormula", found)) == written


def test_a_single_condition_and_untestable_locations_are_noted() -> None:
    def noted(groups: tuple[int, ...], searched: Map) -> list[str]:
        lin = SimpleNamespace(regions=SimpleNamespace(groups=groups))
        diagnosis: Any = SimpleNamespace(before=SimpleNamespace(linearisation=lin), notes=())
        return [
            note.text for note in notes(Discovery((), "", cast("Any", None), searched, (), (), 0, diagnosis))
        ]

    hidden = located("position_reading", 0.0, 1.0, 0)
    one, untestable = noted((0, 0, 0), Map((), (hidden,), 1, 1.0, 5.0))
    assert "one condition" in one
    assert "position_reading over velocity" in untestable
    assert noted((0, 1), Map((), (), 1, 1.0, 5.0)) == []


def test_locations_that_explain_nearly_as_much_are_rivals_unless_refuted() -> None:
    found = (
        located("friction", 4000.0),
        located("friction", 3990.0),
        located("load", 3950.0, dof=25),
        located("mass", 3900.0),
        located("line_resistance", 3700.0),
    )
    for refuted, left in (((), ["load", "mass"]), (("load",), ["mass"])):
        known = SimpleNamespace(located=found, refuted=frozenset(refuted))
        rivals = Discovery.rivals.fget(known)  # type: ignore[attr-defined]
        assert [one.slot.name for one in rivals] == left


def formula(slot: str, *over: str, same: tuple[Any, ...] = ()) -> Any:
    return SimpleNamespace(slot=FAMILY.slot(slot), over=over, same=same, name=f"{slot}_power")


def made(formulas: tuple[Any, ...], *places: Located) -> Discovery:
    """A finished search with these formulas and locations."""
    searched = Map(places, (), 10, 8.0, 5.0)
    shown = tuple(
        cast(
            "FoundFormula",
            SimpleNamespace(
                fitted=SimpleNamespace(formula=one),
                slot=one.slot.name,
                term="size*velocity",
                alike=tuple(other.name for other in one.same),
                left=0.0,
                doubt=None,
                p_value_after=0.5,
            ),
        )
        for one in formulas
    )
    return Discovery((), "m", cast("Any", None), searched, (), shown, 50, cast("Any", None))


VELOCITY_ONLY = formula("friction", "velocity")


@pytest.mark.parametrize(
    ("answer", "slots", "drivers", "said"),
    [
        (
            made((VELOCITY_ONLY,), located("friction", 400.0)),
            ["friction"],
            [["velocity"]],
            " at friction over velocity; of 50 formulas one remains: size*velocity",
        ),
        (  # another slot at which the same term has the same influence
            made((VELOCITY_ONLY,), replace(located("friction", 400.0), alike=("load",))),
            ["friction", "load"],
            [["velocity"]],
            ", its location uncertain (friction or load), over velocity; of 50 formulas one remains: size*",
        ),
        (  # another location explains as much, although none of its formulas is in the set
            made((VELOCITY_ONLY,), located("friction", 400.0), located("mass", 399.0)),
            ["friction", "mass"],
            [["velocity"]],
            ", its location uncertain (friction or mass), over velocity",
        ),
        (  # two formulas at one location, over different variables
            made((VELOCITY_ONLY, formula("friction", "position")), located("friction", 400.0)),
            ["friction"],
            [["velocity"], ["position"]],
            " at friction, its variable uncertain (velocity or position); of 50 formulas 2 remain",
        ),
        (  # one formula, equivalent to another at another location and over another variable
            made(
                (formula("friction", "velocity", same=(formula("load", "spool"),)),),
                located("friction", 400.0),
            ),
            ["friction", "load"],
            [["velocity"], ["spool"]],
            ", its location and variable uncertain (friction over velocity or load over spool); of 50",
        ),
        (
            made((), located("friction", 400.0), located("mass", 399.0)),
            ["friction", "mass"],
            [["velocity"]],
            ", its location uncertain (friction or mass), over velocity; none of the 50 formulas tried",
        ),
    ],
)
def test_the_answer_names_all_locations_and_variables_that_it_cannot_distinguish(
    answer: Discovery, slots: list[str], drivers: list[list[str]], said: str
) -> None:
    assert list(dict.fromkeys(one.slot for one in answer.where)) == slots
    assert [list(over) for over in dict.fromkeys(one.over for one in answer.where)] == drivers
    assert statement(answer).startswith(f"A term is missing{said}")


def test_a_large_class_of_locations_is_abbreviated_to_a_few_and_a_count() -> None:
    names = [slot.name for slot in FAMILY.slots][:9]
    answer = made(
        (VELOCITY_ONLY,),
        replace(located("friction", 400.0), alike=tuple(n for n in names if n != "friction")),
    )
    assert f"or {len(answer.where) - 6} more)" in statement(answer)


@pytest.mark.parametrize(
    ("check", "said"),
    [
        (None, "There is no second record to test it on"),
        (
            CrossValidation(math.nan, math.nan, 0.0, 0.0, 1),
            "It is not determined without the records that could be left out",
        ),
        (CrossValidation(1.0, 1.2, -5.0, 1.0, 4), "It does not predict the conditions left out"),
    ],
)
def test_a_formula_that_is_not_accepted_comes_with_the_reason(
    check: CrossValidation | None, said: str
) -> None:
    """Of a single record it was said that its formula "does not predict the conditions left out"."""
    answer = made((VELOCITY_ONLY,), located("friction", 400.0))
    (one,) = answer.formulas
    found: Any = SimpleNamespace(check=check, left=0.0)
    doubt = FoundFormula.doubt.__get__(found)
    shown: Any = SimpleNamespace(**{**vars(one), "doubt": doubt})
    assert statement(replace(answer, formulas=(shown,))).endswith(f". {said}, and it should not be relied on")


def test_where_no_term_would_be_visible_the_search_says_so() -> None:
    opened = cast("Any", SimpleNamespace(slots=(), drivers=()))
    found = locate(opened, 100.0)
    assert not found.sure
    assert found.most_wanted == ()
    assert "would not be visible in these data at any location" in too_weak(found)


@pytest.mark.parametrize(
    ("reason", "said"), [("adequate", "writes a page"), ("replicates", "plots where the model fails")]
)
def test_a_model_that_agrees_is_not_said_to_fail(
    reason: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    found: Any = SimpleNamespace(formulas=(), gate=SimpleNamespace(reason=reason))
    _suggest_next(found, ["latest"], "own.yaml", DataOptions(), None, saved=False)
    printed = capsys.readouterr()
    assert said in printed.out + printed.err


def test_the_suggested_search_is_at_the_same_location(capsys: pytest.CaptureFixture[str]) -> None:
    """Without --slot it would have written the formulas of another search."""
    accepted = SimpleNamespace(accepted=True, file=None)
    found: Any = SimpleNamespace(formulas=(accepted,), gate=SimpleNamespace(reason="open"))
    _suggest_next(found, ["latest"], "own.yaml", DataOptions(only="record > 3"), "friction", saved=False)
    suggested = 'rigctl discover latest --model own.yaml --slot friction --only "record > 3" -o effects'
    assert suggested in capsys.readouterr().out
