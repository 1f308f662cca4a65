"""Settings of actuators in files: the name of a position, or a number with its unit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from rigctl.errors import unknown_name
from rigctl.files.amount import Amount, AmountField
from rigctl.files.quantity import reader_schema
from rigctl.units import parse_unit

#: the values of an actuator's positions by name, for the kinds of actuators that have positions
POSITIONS: Mapping[str, Mapping[str, float]] = {
    "switch": {"off": 0.0, "on": 1.0},
    "directional_valve": {"retract": -1.0, "neutral": 0.0, "extend": 1.0},
}

_WORDS = {word: number for words in POSITIONS.values() for word, number in words.items()}


class SettingField:
    """Reads the name of a position, or an amount; it is checked against its actuator with the whole file."""

    def read(self, written: object) -> Amount:
        """Return the setting as an SI number that retains its text.

        Raises
        ------
        RigctlError
            it is neither the name of a position nor a quantity.
        """
        if isinstance(written, str) and written in _WORDS:
            return Amount(_WORDS[written], parse_unit("1"), written)
        if isinstance(written, str) and written[:1].isalpha():
            raise unknown_name("position", written, _WORDS)
        return AmountField().read(written)

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Read with `read`; a RigctlError becomes an error of the field."""
        return reader_schema(self.read)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Describe a text or a number."""
        return {"type": ["string", "number"], "examples": [*_WORDS, "20 bar"]}


Setting = Annotated[Amount, SettingField()]
