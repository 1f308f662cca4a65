"""Why there is no next experiment, for those who go on without one."""

from __future__ import annotations

from rigctl.errors import RigctlError


class TooLittleTime(RigctlError):
    """The budget is too small for any record."""


class NothingLeft(RigctlError):
    """Nothing is left to tell apart, or nothing that these records could."""


class NothingToSet(RigctlError):
    """Nothing on a rig sets the conditions of a record.

    Attributes
    ----------
    sensors: channels that would tell the rivals apart in the records so far, taken again.
    """

    sensors: tuple[str, ...] = ()
