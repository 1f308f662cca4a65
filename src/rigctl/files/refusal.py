"""Carry an error of ours through pydantic, so that it comes out at the right place of the file."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic_core import PydanticCustomError

from rigctl.errors import RigctlError

TYPE = "rigctl"


def refusal(error: RigctlError, keys: Sequence[str | int] = ()) -> PydanticCustomError:
    """What a validator raises to refuse a value with `error`.

    Parameters
    ----------
    error: what the user reads; its place is filled in by `rigctl.files.validate`.
    keys: from the value being validated to the part that is wrong.
    """
    return PydanticCustomError(
        TYPE, "{message}", {"message": error.what, "error": error, "keys": tuple(keys)}
    )
