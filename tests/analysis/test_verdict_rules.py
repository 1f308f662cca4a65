"""The rules behind a verdict, each by itself: what alone takes a claim away, and what alone leaves it."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from linear_problem import PLAIN, compared, made_design, made_effect
from rigctl.analysis.agreement.adequacy import Adequacy, Test, chi2_test
from rigctl.analysis.collected_evidence import evidence_for
from rigctl.analysis.diagnosis_result import Ranked, Verdict
from rigctl.analysis.evidence import Evidence
from rigctl.analysis.linear.cross_validation import CrossValidation
from rigctl.analysis.search import judgement
from rigctl.analysis.search.identity import (
    Levels,
    certain_members,
    levels_of,
    only_constants,
    same_cause,
    wanted_elsewhere,
)
from rigctl.analysis.search.judgement import Judgement, _sure_members, verdict_on
from rigctl.analysis.search.reasons import OnlyEdgesSearched
from rigctl.analysis.search.remainder import Remainder
from rigctl.analysis.search.rivals import Rival
from rigctl.analysis.search.search import Search
from rigctl.answers.findings import evidence as in_words
from rigctl.effects.declaration import Effect
from rigctl.effects.registry import library
from rigctl.physics.families import find_family

EVERYTHING, ALL_BUT_LAW, LOCATION, NOTHING = (
    (True, True, True),
    (True, True, False),
    (True, False, False),
    (False, False, False),
)
LEFT = Remainder(0.01, 20.0, 1e-6, "", "", "")
KNOWN = library(find_family("hydraulic_cylinder"))
#: over a variable; another law of it; at another location; a constant
FRICTION, ITS_LAW = KNOWN["viscous_friction"], replace(KNOWN["viscous_friction"], name="its_law")
ELSEWHERE, CONSTANT = KNOWN["line_loss"], made_effect("constant")


def level(*names: Effect, **changed: Any) -> tuple[bool, bool, bool]:
    found = levels_of(
        [tuple(one.name for one in names)],
        {one.name: one for one in names},
        **({"sure": True, "other_shape": False} | changed),
    )
    return found[0].place_sure, found[0].driver_sure, found[0].law_sure


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({}, EVERYTHING),
        ({"sure": False}, NOTHING),
        ({"usual": False}, ALL_BUT_LAW),
        ({"other_shape": True}, ALL_BUT_LAW),
        ({"complete": False}, ALL_BUT_LAW),
        ({"spare": ["viscous_friction"]}, ALL_BUT_LAW),
        ({"spare": ["another"]}, EVERYTHING),
        ({"constant": {"viscous_friction": ["velocity"]}}, (True, False, True)),
        ({"constant": {"viscous_friction": []}}, EVERYTHING),
        ({"varying": ["viscous_friction"]}, (True, False, True)),
    ],
)
def test_each_condition_takes_away_its_own_level(changed: Any, expected: tuple[bool, bool, bool]) -> None:
    assert level(FRICTION, **changed) == expected


def test_a_constant_that_leaves_something_may_depend_on_something_unless_it_only_scatters() -> None:
    assert level(CONSTANT) == EVERYTHING
    assert level(CONSTANT, complete=False) == LOCATION
    assert level(CONSTANT, complete=False, steady=["constant"]) == ALL_BUT_LAW


def test_every_effect_that_is_not_distinguished_has_to_agree() -> None:
    assert same_cause(FRICTION, ITS_LAW)
    assert level(FRICTION, ITS_LAW) == ALL_BUT_LAW
    elsewhere = replace(ITS_LAW, terms=ELSEWHERE.terms)
    assert not same_cause(FRICTION, elsewhere)
    assert level(FRICTION, elsewhere) == NOTHING
    size = FRICTION.parameters[0].name
    constant = replace(ITS_LAW, terms=((FRICTION.slots[0], lambda m, p: getattr(p, size)),))
    assert set(constant.slots) == set(FRICTION.slots)
    assert not same_cause(FRICTION, constant)
    assert level(FRICTION, constant) == LOCATION


@pytest.mark.parametrize(
    ("sure", "driver", "certain", "statement"),
    [
        (EVERYTHING, ("v",), "location, variables and law", ""),
        (EVERYTHING, (), "location and law", ""),
        (NOTHING, ("v",), "nothing", ""),
        (
            LOCATION,
            ("v",),
            "location, a term at here",
            "Certain is the location, a term at here, but not what it depends on",
        ),
        (
            ALL_BUT_LAW,
            ("v",),
            "location and variables, a term at here over v",
            "Certain are the location and variables: a term at here over v",
        ),
        (
            ALL_BUT_LAW,
            (),
            "location, a constant term at here",
            "Certain is the location, a constant term at here, but not its law",
        ),
    ],
)
def test_what_is_certain_is_said_and_no_more(
    sure: tuple[bool, bool, bool], driver: tuple[str, ...], certain: str, statement: str
) -> None:
    one = Levels("alpha", ("here",), driver, *sure)
    assert in_words.certain(one) == certain
    if statement:
        assert in_words.sentence(Evidence("", ("alpha",), "levels", finding=one)) == statement
    assert certain_members([one]) == (("alpha",) if sure[0] else ())


def test_several_effects_leave_something_where_none_of_them_acts() -> None:
    (slot, *_), (other, *_) = FRICTION.slots, ELSEWHERE.slots
    assert wanted_elsewhere([FRICTION, ITS_LAW], other)
    assert not wanted_elsewhere([FRICTION, ITS_LAW], slot)
    assert not wanted_elsewhere([FRICTION, ELSEWHERE], other)
    assert not wanted_elsewhere([FRICTION], other)
    assert not wanted_elsewhere([FRICTION, ITS_LAW], "")
    assert only_constants([CONSTANT, CONSTANT])
    assert not only_constants([CONSTANT])
    assert not only_constants([CONSTANT, FRICTION])


# --- cross-validation


@pytest.mark.parametrize(
    ("changed", "passed"),
    [
        ({"mean": 2.1}, True),
        ({"mean": 1.9}, False),
        ({"mean": 2.1, "folds": 1}, False),
        ({"mean": 2.1, "folds": 2}, True),
        ({"sure": 3.1, "least": -2.9}, True),
        ({"sure": 2.9, "least": -2.9}, False),
        ({"sure": 3.1, "least": -3.1}, False),
        ({"sure": 3.1, "least": -2.9, "folds": 1}, False),
    ],
)
def test_a_gain_counts_from_two_standard_errors_or_three_of_all_folds(changed: Any, passed: bool) -> None:
    given = {"before": 2.0, "after": 1.0, "mean": 0.0, "error": 1.0, "folds": 8} | changed
    check = CrossValidation(**given)
    assert check.passed is passed
    ranked = Ranked("x", 1.0, 1e-9, -20.0, 1.0, "", math.nan, math.nan, 0.1, 9.0, {})
    found = evidence_for("x", ranked, check, [], several=False)
    sides = [one.side for one in found if one.quantity == "left_out_error"]
    assert sides == ([] if not check.possible else ["for"] if passed else ["against"])


# --- the tests of a model


def test_a_noise_known_from_few_readings_makes_the_total_misfit_less_telling() -> None:
    """The rate of false alarms stays near its level where χ² is taken in units of an estimated variance."""
    rng, counts, degrees = np.random.default_rng(4), (300, 100), (400, 200)
    problem = SimpleNamespace(
        noise=SimpleNamespace(channels=[SimpleNamespace(degrees=known) for known in degrees]),
        ok=[np.arange(300)[:, None] < np.array(counts)],
        only=lambda fitted: problem,
    )
    lin = SimpleNamespace(fit=SimpleNamespace(problem=problem, fitted=(0,)))
    draws = 1500
    chi2 = sum(
        rng.chisquare(count, draws) * known / rng.chisquare(known, draws)
        for count, known in zip(counts, degrees, strict=True)
    )
    p_values = [
        chi2_test(
            cast(
                "Any",
                SimpleNamespace(
                    linearisation=lin,
                    residual=np.array([math.sqrt(one)]),
                    dof=sum(counts),
                    noise_degrees=0,
                    records=(0,),
                ),
            )
        ).p_value
        for one in np.asarray(chi2)
    ]
    assert 0.04 < np.mean(np.array(p_values) < 0.05) < 0.09
    assert 0.10 < np.mean(np.array(p_values) < 0.15) < 0.20


def test_bonferroni_counts_the_tests_that_were_made() -> None:
    one, two = {"chi2": Test(1.0, 0.008)}, {"chi2": Test(1.0, 0.008), "plane": Test(1.0, 0.5)}
    assert Adequacy(one).rejected
    assert not Adequacy(two).rejected
    assert Adequacy(two).p_value == pytest.approx(0.016)
    assert Adequacy({"chi2": Test(1.0, 0.7), "plane": Test(1.0, 0.9)}).p_value == 1.0


CLEAN, REJECTED = {"chi2": Test(1.0, 0.5)}, {"chi2": Test(1.0, 1e-6)}
SENSOR = cast("Any", SimpleNamespace(beyond=[SimpleNamespace(of=("calibration", "left", 1))]))
FINE = cast("Any", SimpleNamespace(beyond=[]))


@pytest.mark.parametrize(
    ("given", "agrees", "adequate", "undecided", "only_misread", "verdict"),
    [
        (Adequacy(CLEAN), True, True, False, False, True),
        (Adequacy(CLEAN, sensors=FINE), True, True, False, False, True),
        (Adequacy(REJECTED), False, False, False, False, False),
        (Adequacy(REJECTED, below_noise=True), False, True, False, False, None),
        (Adequacy(CLEAN, unproven=("left",)), False, False, True, False, None),
        (Adequacy(REJECTED, unproven=("left",)), False, False, False, False, False),
        (Adequacy(REJECTED, unusable=("left",)), False, False, True, False, None),
        (Adequacy(CLEAN, unusable=("left",)), False, False, True, False, None),
        (Adequacy(CLEAN, stated=("left",)), True, True, False, False, True),
        (Adequacy(CLEAN, sensors=SENSOR), False, False, False, True, False),
        (Adequacy(REJECTED, sensors=SENSOR), False, False, False, False, False),
        (Adequacy(CLEAN, sensors=SENSOR, unproven=("right",)), False, False, True, False, None),
        (Adequacy(CLEAN, sensors=SENSOR, unusable=("right",)), False, False, True, False, None),
    ],
)
def test_what_may_be_said_follows_from_the_tests_and_the_standing_of_the_noise(
    given: Adequacy, agrees: bool, adequate: bool, undecided: bool, only_misread: bool, verdict: bool | None
) -> None:
    found = (given.agrees, given.adequate, given.undecided, given.only_misread, given.verdict)
    assert found == (agrees, adequate, undecided, only_misread, verdict)


# --- the judgement of a set


def judged(of_set: Verdict, **changed: Any) -> Judgement:
    """A judgement of one effect, alpha, without anything against it but what is given."""
    answer = SimpleNamespace(
        checks={"alpha": CrossValidation(2.0, 2.0, 0.0, 1.0, 8)}, against=lambda certain=(): ["a check"]
    )
    best = SimpleNamespace(effects=("alpha",), candidates=(SimpleNamespace(name="alpha"),))
    given: dict[str, Any] = {"rivals": (), "answer": answer, "every_law": None, "scatters": ()} | changed
    made = Judgement(cast("Any", None), cast("Any", best), **given)
    vars(made)["of_set"] = of_set
    vars(made)["edges"] = ()  # its equations are not in an FMU
    vars(made)["laws"] = tuple(given.get("every_law") or ())
    return made


def law(constant: bool, effect: str = "alpha") -> Any:
    return SimpleNamespace(constant=constant, effect=effect)


def scatter(follows: bool) -> Any:
    return SimpleNamespace(follows=follows)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({}, ()),
        ({"every_law": [law(True)]}, (law(True),)),
        ({"every_law": [law(False)]}, ()),
        ({"every_law": [law(True, "another")]}, ()),
        ({"scatters": (scatter(True),)}, (scatter(True),)),
        ({"scatters": (scatter(False),)}, ()),
    ],
)
def test_an_effect_whose_own_variable_does_not_matter_is_not_certain(
    changed: Any, why: tuple[Any, ...]
) -> None:
    one = judged(Verdict.MISSING_EFFECT, **changed)
    assert one.undriven == why
    assert one.verdict is (Verdict.AMBIGUOUS if why else Verdict.MISSING_EFFECT)
    assert one.unconfirmed == (() if why else ("alpha",))
    assert judged(Verdict.OUTSIDE_LIBRARY, **changed).verdict is Verdict.OUTSIDE_LIBRARY


def test_an_effect_at_the_edge_of_an_fmu_is_never_certain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its cause may be inside, where nothing was searched."""
    monkeypatch.setattr(judgement, "certain_levels", lambda *_: ("a level",))
    one = judged(Verdict.MISSING_EFFECT)
    vars(one)["edges"] = (OnlyEdgesSearched("motor.fmu", "the FMU", ""),)
    assert one.verdict is Verdict.AMBIGUOUS
    assert one.levels == ()
    assert one.unconfirmed == ()


def test_more_records_may_confirm_an_effect_only_if_nothing_else_speaks_against_it() -> None:
    rival = cast("Rival", SimpleNamespace(separable=False))
    far = cast("Rival", SimpleNamespace(separable=True))
    assert judged(Verdict.AMBIGUOUS, rivals=(far,)).unconfirmed == ("alpha",)
    assert judged(Verdict.AMBIGUOUS, rivals=(rival,)).unconfirmed == ()
    assert judged(Verdict.OUTSIDE_LIBRARY).unconfirmed == ()
    two = judged(Verdict.AMBIGUOUS)
    two.answer.against = lambda certain=(): ["a check", "a bound"]  # type: ignore[method-assign]
    assert two.unconfirmed == ()


@pytest.mark.parametrize("of_set", list(Verdict))
@pytest.mark.parametrize("own", [True, False])
@pytest.mark.parametrize("given", [None, "given"])
def test_levels_classes_and_the_scale_of_what_is_left_need_a_named_set(
    monkeypatch: pytest.MonkeyPatch, of_set: Verdict, own: bool, given: str | None
) -> None:
    """In the scale of its own errors, a model without a named set is shown as it was compared."""
    named = of_set in (Verdict.MISSING_EFFECT, Verdict.AMBIGUOUS)
    monkeypatch.setattr(judgement, "certain_levels", lambda *_: ("a level",))
    one = judged(of_set)
    vars(one)["search"] = SimpleNamespace(given=given, before="before", in_own_scale=own)
    one.answer.classes = (("alpha",),)  # type: ignore[misc]
    assert one.named is named
    assert one.levels == (("a level",) if named else ())
    assert one.classes == ((("alpha",),) if named else ())
    assert one.shown == ("given" if given and own and not named else "before")


@pytest.fixture(scope="module")
def pair() -> tuple[Search, Any]:
    """A search, and a set of a large and a small effect."""
    design = made_design(PLAIN, np.eye(len(PLAIN)))
    before = compared(
        design, design.readings({"alpha.size": 300.0, "beta.size": 30.0}, design.typical_noise())
    )
    search = Search(before, before.whole)
    alpha, beta = (one for one in before.linearisation.candidates if one.name in ("alpha", "beta"))
    first, _ = (search.refitted([one], search.null) for one in (alpha, beta))
    assert first is not None
    return search, search.refitted([alpha, beta], first)


@pytest.mark.parametrize(
    ("changed", "kept"),
    [
        ({}, ("alpha",)),
        ({"same": True}, ("alpha", "beta")),  # two laws of one cause
        ({"separable": True}, ("alpha", "beta")),
        ({"member": "alpha"}, ("alpha", "beta")),  # of the large one: it does not go
        ({"excess": 0.0}, ("alpha", "beta")),  # nothing is left with both: something is there
    ],
)
def test_a_small_member_that_another_effect_may_be_is_left_out_of_the_answer(
    pair: tuple[Search, Any], monkeypatch: pytest.MonkeyPatch, changed: Any, kept: tuple[str, ...]
) -> None:
    given = {"same": False, "separable": False, "member": "beta", "excess": 1.0} | changed
    elsewhere = replace(made_effect("gamma"), terms=(("elsewhere", lambda m, p: p.size),))
    rival = SimpleNamespace(member=given["member"], name="gamma", separable=given["separable"])
    monkeypatch.setattr(judgement, "find_rivals", lambda *_: [rival])
    monkeypatch.setattr(Search, "excess", lambda *_: given["excess"])
    other = made_effect("gamma") if given["same"] else elsewhere
    monkeypatch.setattr(Search, "effect", lambda _, name: other if name == "gamma" else made_effect(name))
    search, best = pair
    assert _sure_members(search, best)[0].effects == kept


@pytest.mark.parametrize(
    ("changed", "verdict"),
    [
        ({}, Verdict.MISSING_EFFECT),
        ({"close": [cast("Rival", None)]}, Verdict.AMBIGUOUS),
        ({"reasons": ["a bound"]}, Verdict.AMBIGUOUS),
        ({"failed": True}, Verdict.MISSING_EFFECT),
        ({"remaining": LEFT}, Verdict.MISSING_EFFECT),
        ({"failed": True, "remaining": LEFT}, Verdict.OUTSIDE_LIBRARY),
        ({"failed": True, "remaining": LEFT, "count": 1}, Verdict.MISSING_EFFECT),
        ({"sure": False}, Verdict.OUTSIDE_LIBRARY),
        ({"count": 0}, Verdict.OUTSIDE_LIBRARY),
    ],
)
def test_a_set_is_named_unless_something_speaks_against_it(
    monkeypatch: pytest.MonkeyPatch, changed: Any, verdict: Verdict
) -> None:
    given = {
        "close": [],
        "reasons": [],
        "failed": False,
        "remaining": None,
        "sure": True,
        "count": 2,
    } | changed
    monkeypatch.setattr(judgement, "_nothing_to_name", lambda *_: None)
    monkeypatch.setattr(judgement, "evidence_against", lambda *_: given["reasons"])
    check = CrossValidation(2.0, 1.0, 0.0 if given["failed"] else 3.0, 1.0, 8)
    search: Any = SimpleNamespace(sure=lambda best: given["sure"])
    best: Any = SimpleNamespace(candidates=(None,) * given["count"])
    assert verdict_on(search, best, given["close"], {"alpha": check}, given["remaining"]) is verdict


def nothing_to_name(
    monkeypatch: pytest.MonkeyPatch,
    before: Adequacy,
    given: Adequacy | None = None,
    *,
    own: bool = False,
    start: Adequacy | None = None,
    proven: bool = False,
    blocks: bool | None = None,
) -> Verdict | None:
    monkeypatch.setattr(judgement, "proven_by_collapse", lambda *_: proven)
    search: Any = SimpleNamespace(
        before=SimpleNamespace(adequacy=before),
        given=None if given is None else SimpleNamespace(adequacy=given),
        null_tests=SimpleNamespace(adequacy=start or REJECTS),
        in_own_scale=own,
    )
    passed: Any = None if blocks is None else SimpleNamespace(passed=blocks)
    return judgement._nothing_to_name(search, cast("Any", None), passed)


AGREES, REJECTS = Adequacy(CLEAN), Adequacy(REJECTED)
BELOW, UNUSABLE = Adequacy(REJECTED, below_noise=True), Adequacy(CLEAN, unusable=("left",))
OPEN, MISREAD = Adequacy(CLEAN, unproven=("left",)), Adequacy(CLEAN, sensors=SENSOR)
STATED = Adequacy(CLEAN, stated=("left",))


@pytest.mark.parametrize(
    ("before", "more", "verdict"),
    [
        (REJECTS, {}, None),
        (AGREES, {}, Verdict.ADEQUATE),
        (REJECTS, {"start": AGREES}, Verdict.ADEQUATE),
        (BELOW, {}, Verdict.UNDECIDED),
        (UNUSABLE, {}, Verdict.UNDECIDED),
        (MISREAD, {}, Verdict.OUTSIDE_LIBRARY),
        (AGREES, {"own": True}, Verdict.ADEQUATE),
        (AGREES, {"own": True, "given": OPEN}, Verdict.UNDECIDED),
        (AGREES, {"own": True, "given": REJECTS}, Verdict.OUTSIDE_LIBRARY),
        (AGREES, {"given": REJECTS}, Verdict.ADEQUATE),
        (BELOW, {"own": True, "given": REJECTS}, Verdict.UNDECIDED),
        (REJECTS, {"own": True}, Verdict.OUTSIDE_LIBRARY),
        (REJECTS, {"own": True, "given": AGREES}, Verdict.ADEQUATE),
        (REJECTS, {"own": True, "given": OPEN}, Verdict.UNDECIDED),
        (REJECTS, {"own": True, "proven": True}, None),
        (REJECTS, {"own": True, "proven": True, "blocks": True}, None),
        (REJECTS, {"own": True, "proven": True, "blocks": False}, Verdict.OUTSIDE_LIBRARY),
        (STATED, {}, Verdict.ADEQUATE),
        (STATED, {"own": True, "proven": True}, None),  # what proves itself refutes the statement
        (STATED, {"own": True}, Verdict.ADEQUATE),
    ],
)
def test_nothing_is_named_where_the_model_agrees_or_nothing_proves_itself(
    monkeypatch: pytest.MonkeyPatch, before: Adequacy, more: Any, verdict: Verdict | None
) -> None:
    assert nothing_to_name(monkeypatch, before, **more) is verdict
