"""The JSON Schema for editors agrees with the reader."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from rigctl.files.schema import json_schema
from rigctl.files.yaml import parse_document, read_document
from rigctl.procedure import ProcedureFile
from rigctl.steps.registry import BY_VERB, STEPS

PROCEDURES = sorted((Path(__file__).parents[2] / "procedures").glob("*.yaml"))


@pytest.fixture(scope="module")
def validator() -> Draft202012Validator:
    schema = json_schema(ProcedureFile, title="rigctl procedure")
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


@pytest.mark.parametrize("path", PROCEDURES, ids=lambda path: path.stem)
def test_shipped_procedures_are_valid_under_the_schema(validator: Draft202012Validator, path: Path) -> None:
    assert [error.message for error in validator.iter_errors(read_document(path).data)] == []


@pytest.mark.parametrize(
    "steps",
    [
        "[{wait: 3}]",
        "[{wait: {fro: 3 s}}]",
        "[{heet: 40 degC}]",
        "[{for: {a: 3 s}, do: [{wait: 1 s}]}]",
        "[{record: {name: a b}, do: [{wait: 1 s}]}]",
        "[{measure: {name: a, value: max(position), unit: mm, over: night}}]",
        "[]",
        "{}",
    ],
)
def test_mistakes_are_invalid_under_the_schema(validator: Draft202012Validator, steps: str) -> None:
    data: Any = parse_document(f"procedure: x\nsteps: {steps}\n").data
    assert not validator.is_valid(data)


def test_every_step_is_in_the_schema_and_documented(validator: Draft202012Validator) -> None:
    definitions: dict[str, Any] = validator.schema["$defs"]  # type: ignore[index]
    assert {step.__name__ for step in STEPS} <= definitions.keys()
    for verb, step in BY_VERB.items():
        assert verb in definitions[step.__name__]["required"]
        assert definitions[step.__name__]["description"]


def test_every_field_is_described(validator: Draft202012Validator) -> None:
    definitions: dict[str, Any] = validator.schema["$defs"]  # type: ignore[index]
    undescribed = [
        f"{name}.{field}"
        for name, definition in definitions.items()
        if name.endswith("Fields") or name == "Spaced"
        for field, schema in definition.get("properties", {}).items()
        if "description" not in schema
    ]
    assert undescribed == []
