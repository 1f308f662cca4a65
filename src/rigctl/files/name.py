"""Names that users choose in files: of channels, actuators, limits, variables, measures."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import BeforeValidator, Field

from rigctl.errors import RigctlError
from rigctl.files.refusal import refusal

NAME_PATTERN = r"^[A-Za-z][A-Za-z0-9_]{0,63}$"


def read_name(written: object) -> str:
    """Return the name in the file, after checking it.

    Raises
    ------
    RigctlError
        it cannot be used in an expression or as the name of a column.
    """
    if isinstance(written, str) and re.fullmatch(NAME_PATTERN, written):
        return written
    raise RigctlError(
        "not a name",
        value=str(written),
        expected="a letter, then letters, digits and _, e.g. supply_pressure",
    )


def _validate(written: object) -> str:
    try:
        return read_name(written)
    except RigctlError as error:
        raise refusal(error) from error


#: a name that expressions can use
Name = Annotated[str, BeforeValidator(_validate), Field(pattern=NAME_PATTERN)]
