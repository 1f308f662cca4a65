"""The base class of all parts of a rig file."""

from __future__ import annotations

from datetime import date
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict

from rigctl.errors import RigctlError
from rigctl.files.refusal import refusal


class RigFilePart(BaseModel):
    """A part of a rig file: frozen; unknown fields are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True, validate_default=False)


def _text_of_date(written: object) -> object:
    # pydantic would read a bare number as seconds since 1970
    if isinstance(written, date | str):
        return written
    raise refusal(RigctlError("no date", value=str(written), expected="a date, e.g. 2026-03-14"))


IsoDate = Annotated[date, BeforeValidator(_text_of_date)]
