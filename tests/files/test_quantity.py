"""Quantities as fields: SI inside, JSON Schema outside."""

from __future__ import annotations

import json
import pickle
import re
from copy import deepcopy
from typing import Annotated

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel

from rigctl.errors import RigctlError
from rigctl.files.amount import Amount, AmountField, AnyAmount, AnyDifference
from rigctl.files.quantity import AnyQuantity, Q, in_dimension, read_quantity
from rigctl.files.schema import json_schema
from rigctl.units import parse_quantity


class Fields(BaseModel):
    pressure: Annotated[float, Q("Pa")]
    tolerance: Annotated[float, Q("K", difference=True)]
    share: Annotated[float, Q("1")]
    anything: AnyQuantity
    amount: AnyAmount
    noise: AnyDifference


FILLED = {
    "pressure": "30 bar",
    "tolerance": "0.5 degC",
    "share": 0.5,
    "anything": "3 mm",
    "amount": "20 degC",
    "noise": "0.1 degC",
}


def test_fields_hold_si_values() -> None:
    fields = Fields.model_validate(FILLED)
    assert fields.pressure == 3e6
    assert fields.tolerance == 0.5
    assert fields.share == 0.5
    assert fields.anything.si == 3e-3
    assert fields.amount == pytest.approx(293.15)
    assert fields.noise == 0.1


def test_fields_with_quantities_can_be_written_as_json() -> None:
    written = json.loads(Fields.model_validate(FILLED).model_dump_json())
    assert written["pressure"] == 3e6
    assert written["anything"] == "3 mm"


@pytest.mark.parametrize(
    "written", [True, None, [1], {"a": 1}, "", "bar", "30", 30, "nan", "1e999 bar", "3 3 bar"]
)
def test_invalid_pressures_are_refused(written: object) -> None:
    with pytest.raises(RigctlError):
        Q("Pa").read(written)


def test_a_plain_number_needs_no_unit() -> None:
    assert Q("1").read(5) == 5.0
    assert Q("1").read("50 %") == 0.5


@pytest.mark.parametrize(
    ("field", "written", "what", "expected"),
    [
        (Q("Pa", low="1 bar"), "0.5 bar", "too small", "at least 1 bar"),
        (Q("Pa", high="50 bar"), "51 bar", "too large", "at most 50 bar"),
        (Q("s", positive=True), "0 s", "must be greater than zero", None),
        (Q("Pa"), "3 s", "wrong dimension", "a pressure, e.g. '30 bar'"),
        (Q("bar"), "3", "the unit is missing", "a pressure, e.g. '30 bar'"),
        (Q("N*s/m"), "3 s", "wrong dimension", "a quantity in N*s/m"),
    ],
)
def test_a_refused_quantity_is_reported_with_what_was_expected(
    field: Q, written: str, what: str, expected: str | None
) -> None:
    with pytest.raises(RigctlError) as caught:
        field.read(written)
    assert caught.value.what == what
    assert caught.value.value == written
    assert caught.value.expected == expected


def test_bounds_are_inclusive() -> None:
    assert Q("Pa", low="1 bar", high="2 bar").read("2 bar") == 2e5


@given(st.floats(-1e6, 1e6), st.sampled_from(["bar", "Pa", "kPa", "MPa"]))
def test_the_schema_matches_what_is_read(value: float, unit: str) -> None:
    text = f"{value!r} {unit}"
    assert Q("Pa").read(text) == pytest.approx(parse_quantity(text).si)
    pattern = json_schema(Fields, title="t")["properties"]["pressure"]["pattern"]
    assert re.search(pattern, text)


def test_the_schema_refuses_a_number_without_a_unit() -> None:
    properties = json_schema(Fields, title="Fields")["properties"]
    assert properties["pressure"]["type"] == "string"
    assert not re.search(properties["pressure"]["pattern"], "30")
    assert properties["pressure"]["examples"] == ["30 bar", "5 MPa"]
    assert properties["tolerance"]["examples"] == ["0.5 K"]
    assert properties["share"]["type"] == ["string", "number"]


def test_an_amount_is_a_float_with_a_unit() -> None:
    amount = AmountField().read("30 bar")
    assert amount == 3e6
    assert amount.text == "30 bar"
    assert isinstance(amount + 1, float)
    amount.check("Pa")
    with pytest.raises(RigctlError, match="wrong dimension, got '30 bar'; expected a length"):
        amount.check("mm")
    with pytest.raises(RigctlError, match="the unit is missing, got '30'"):
        AmountField().read(30).check("bar")


@pytest.mark.parametrize("copy", [deepcopy, lambda amount: pickle.loads(pickle.dumps(amount))])
def test_an_amount_can_be_copied(copy: object) -> None:
    amount = AmountField().read("30 bar")
    twin = copy(amount)  # type: ignore[operator]
    assert isinstance(twin, Amount)
    assert (twin, twin.text, twin.unit) == (amount, amount.text, amount.unit)


def test_a_quantity_can_be_converted_once_its_dimension_is_known() -> None:
    quantity = read_quantity("0.5 degC")
    assert in_dimension(quantity, "K", difference=True) == 0.5
    assert read_quantity(quantity) is quantity
    with pytest.raises(RigctlError, match="wrong dimension"):
        in_dimension(quantity, "bar")


def test_a_quantity_keeps_every_digit_that_was_written() -> None:
    assert in_dimension(read_quantity("1132.5833 K"), "K") == 1132.5833
    assert in_dimension(read_quantity(0.123456789), "1") == 0.123456789
