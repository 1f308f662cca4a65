"""Reasons why there is no next experiment, for callers that continue without one."""

from __future__ import annotations

from rigctl.errors import RigctlError


class TooLittleTime(RigctlError):
    """The budget is too small for any record."""


class NothingLeft(RigctlError):
    """Nothing is left to be distinguished, or nothing that these records could distinguish."""


class NothingToSet(RigctlError):
    """No actuator of a rig sets the conditions of a record.

    Attributes
    ----------
    sensors: channels that would distinguish the rivals in the records so far, taken again.
    """

    sensors: tuple[str, ...] = ()
