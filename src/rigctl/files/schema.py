"""JSON Schemas of the files that users write, with which editors complete and check them."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

DRAFT = "https://json-schema.org/draft/2020-12/schema"


def json_schema(model: type[BaseModel], *, title: str) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a file whose pydantic model is `model`."""
    schema = model.model_json_schema(by_alias=True, mode="validation")
    return {**schema, "$schema": DRAFT, "title": title}
