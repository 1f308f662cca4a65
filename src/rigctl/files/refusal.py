"""Passes a RigctlError through pydantic, so that it is reported with the right location in the file."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic_core import PydanticCustomError

from rigctl.errors import RigctlError

TYPE = "rigctl"


def refusal(error: RigctlError, keys: Sequence[str | int] = ()) -> PydanticCustomError:
    """Return the exception with which a validator refuses a value because of `error`.

    Parameters
    ----------
    error: the message; `rigctl.files.validate` adds the location.
    keys: path from the value being validated to the part that is wrong.
    """
    return PydanticCustomError(
        TYPE, "{message}", {"message": error.what, "error": error, "keys": tuple(keys)}
    )
