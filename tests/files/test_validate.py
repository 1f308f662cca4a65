"""Errors in a document, with their location and the user's names."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, field_validator

from rigctl.effects.user.load import load_effect
from rigctl.errors import Location, RigctlError, SeveralErrors
from rigctl.files.quantity import AnyQuantity, Q
from rigctl.files.refusal import refusal
from rigctl.files.validate import validate
from rigctl.files.yaml import parse_document
from rigctl.model import load_model
from rigctl.model.schema import ModelFile
from rigctl.physics.user.load import load_family
from rigctl.procedure import load_procedure
from rigctl.rig import Rig, load_rig

ROOT = Path(__file__).parents[2]


class Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Heat(Strict):
    kind: Literal["heat"] = "heat"
    to: Annotated[float, Q("K")]
    within: Annotated[float, Q("K", difference=True, positive=True)] = 0.5


class Wait(Strict):
    kind: Literal["wait"]
    time: Annotated[float, Q("s", low="0 s", high="1 h")]


class Plan(Strict):
    name: str = Field(min_length=1)
    count: int = Field(default=1, ge=1, le=10)
    shuffle: bool = False
    mode: Literal["fast", "slow"] = "fast"
    heat: Heat | None = None
    steps: list[Annotated[Heat | Wait, Field(discriminator="kind")]] = []
    constants: dict[str, AnyQuantity] = {}
    either: int | list[int] = 0
    aliased: str = Field(default="", alias="for")

    @field_validator("name")
    @classmethod
    def _no_spaces(cls, name: str) -> str:
        if "!" in name:
            raise refusal(RigctlError("no '!' in a name", value=name, expected="letters"))
        return name


def complaint(text: str) -> RigctlError:
    with pytest.raises(RigctlError) as caught:
        validate(parse_document(text, Path("p.yaml")), Plan)
    return caught.value


def test_a_valid_document_becomes_a_model() -> None:
    document = parse_document(
        "name: x\nheat: {to: 40 degC, within: 0.5 degC}\nfor: y\nconstants: {a: 3 mm}\n"
    )
    plan = validate(document, Plan)
    assert plan.heat is not None
    assert plan.heat.to == pytest.approx(313.15)
    assert plan.heat.within == 0.5
    assert plan.constants["a"].si == 3e-3
    assert plan.aliased == "y"


def test_errors_in_a_part_of_a_document_have_their_place_in_the_file() -> None:
    document = parse_document("plan:\n  name: 1\n", Path("p.yaml"))
    with pytest.raises(RigctlError) as caught:
        validate(document, Plan, keys=("plan",))
    assert caught.value.where == Location(Path("p.yaml"), 2, 9)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("nam: x", "p.yaml:1:1: unknown field, got 'nam'; did you mean 'name'?"),
        ("count: 1", "p.yaml:1:1: the field 'name' is missing"),
        ("name: 1", "p.yaml:1:7: name: wrong kind of value, got '1'; expected text"),
        ("name: ''", "p.yaml:1:7: name: this is empty; expected a text"),
        ("name: a!", "p.yaml:1:7: name: no '!' in a name, got 'a!'; expected letters"),
        ("name: [1]", "p.yaml:1:7: name: wrong kind of value, got 'a list'; expected text"),
        ("[1, 2]", "p.yaml:1:1: wrong kind of value, got 'a list'; expected a mapping (name: value)"),
        (
            "name: x\nmode: fsat",
            "p.yaml:2:7: mode: not a known value, got 'fsat'; expected fast or slow; did you mean 'fast'?",
        ),
        ("name: x\ncount: 0", "p.yaml:2:8: count: too small, got '0'; expected at least 1"),
        ("name: x\ncount: 11", "p.yaml:2:8: count: too large, got '11'; expected at most 10"),
        ("name: x\ncount: 1.5", "p.yaml:2:8: count: wrong kind of value, got '1.5'; expected a whole number"),
        (
            "name: x\nshuffle: maybe",
            "p.yaml:2:10: shuffle: wrong kind of value, got 'maybe'; expected true or false",
        ),
        (
            "name: x\nheat: {to: 40}",
            "p.yaml:2:12: to: the unit is missing, got '40'; expected a temperature, e.g. '40 degC'",
        ),
        (
            "name: x\nheat: {to: 40 bar}",
            "p.yaml:2:12: to: wrong dimension, got '40 bar'; expected a temperature, e.g. '40 degC'",
        ),
        (
            "name: x\nheat: {to: 40 degc}",
            "p.yaml:2:12: to: unknown unit, got 'degc'; expected a unit such as bar, degC, l/min or N*s/m; "
            "did you mean 'degC'?",
        ),
        (
            "name: x\nheat:\n  to: 40 degC\n  within: 0 K",
            "p.yaml:4:11: within: must be greater than zero, got '0 K'",
        ),
        (
            "name: x\nheat: {to: [1]}",
            "p.yaml:2:12: to: a list where a quantity belongs; expected a temperature, e.g. '40 degC'",
        ),
        (
            "name: x\nheat: {to: 1 K, wthin: 1 K}",
            "p.yaml:2:17: unknown field, got 'wthin'; did you mean 'within'?",
        ),
        (
            "name: x\nsteps:\n  - {kind: wait, time: 2 h}",
            "p.yaml:3:24: time: too large, got '2 h'; expected at most 1 h",
        ),
        (
            "name: x\nsteps:\n  - {kind: wait, time: -1 s}",
            "p.yaml:3:24: time: too small, got '-1 s'; expected at least 0 s",
        ),
        (
            "name: x\nsteps:\n  - {kind: wait, tme: 1 s}",
            "p.yaml:3:18: unknown field, got 'tme'; did you mean 'time'?",
        ),
        (
            "name: x\nsteps:\n  - {kind: wiat, time: 1 s}",
            "p.yaml:3:5: steps: not a known value, got 'wiat'; expected heat or wait; did you mean 'wait'?",
        ),
        ("name: x\nsteps:\n  - {to: 1 K}", "p.yaml:3:5: steps: the field 'kind' is missing"),
        ("name: x\nheat: {within: 1 K}", "p.yaml:2:7: the field 'to' is missing"),
        (
            "name: x\nconstants: {a: 3 foo}",
            "p.yaml:2:16: a: unknown unit, got 'foo'; expected a unit such as bar, degC, l/min or N*s/m",
        ),
        (
            "name: x\neither: {}",
            "p.yaml:2:9: either: wrong kind of value, got 'a mapping'; expected a whole number or a list",
        ),
        ("name: x\nfro: 1", "p.yaml:2:1: unknown field, got 'fro'; did you mean 'for'?"),
    ],
)
def test_each_mistake_gives_one_message_with_its_place(text: str, expected: str) -> None:
    assert str(complaint(text)) == expected


def test_every_mistake_is_reported_in_file_order() -> None:
    error = complaint("name: 1\ncount: x\nmoed: fast\n")
    assert isinstance(error, SeveralErrors)
    assert [each.where.line for each in error.errors] == [1, 2, 3]
    assert str(error).count("\n") == 2


def test_an_unknown_field_without_a_near_match_lists_all_fields() -> None:
    assert complaint("name: x\nheat: {to: 1 K, zzz: 1}").expected == "one of kind, to, within"


def test_an_empty_document_lacks_every_field() -> None:
    assert "expected a mapping" in str(complaint(""))


@pytest.mark.parametrize("text", ["root:$6$SECRET:19000\n", "SECRET: 1\nSECRET2: 2\n"])
def test_the_content_of_a_file_of_another_kind_is_not_quoted(tmp_path: Path, text: str) -> None:
    """A procedure may name any file as its rig, and messages go to logs."""
    path = tmp_path / "other.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RigctlError, match="another kind of file") as caught:
        load_rig(path)
    assert "SECRET" not in str(caught.value)
    assert "other.yaml:1:1" in str(caught.value)


OURS = {
    "procedure": ("procedures/quick-check.yaml", load_procedure),
    "rig": ("rigs/hl32-bench.yaml", load_rig),
    "model": ("models/hl32-textbook.yaml", load_model),
    "family": ("models/families/water-tank.yaml", load_family),
    "effect": ("models/effects/piston-leakage-eccentric.yaml", load_effect),
}


@pytest.mark.parametrize("given", OURS)
@pytest.mark.parametrize("wanted", OURS)
def test_a_file_of_another_kind_of_rigctl_is_named_in_one_message(given: str, wanted: str) -> None:
    """A rig file given as a model had a message for each of its keys."""
    path, read = ROOT / OURS[given][0], OURS[wanted][1]
    if given == wanted:
        read(path)
        return
    with pytest.raises(RigctlError, match=rf"this is an? {given} file; expected an? {wanted} file$"):
        read(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("model: hydraulic_cylinder\nchannels: {}\n", "unknown field, got 'channels'"),
        ("name: bench\nmodel: hydraulic_cylinder\n", "the field 'channels' is missing"),
    ],
)
def test_a_file_that_is_only_a_little_off_is_told_its_mistake(text: str, said: str) -> None:
    document = parse_document(text, Path("it.yaml"))
    with pytest.raises(RigctlError, match=said):
        validate(document, Rig if "name" in text else ModelFile)
