"""Whether a number that a device holds is the one that was written, where it is kept in another form."""

from __future__ import annotations

_ROUNDING = 1e-6  # relative: a number of four bytes has seven digits


def is_near(read: float, written: float, within: float = 0.0) -> bool:
    """Return whether a number that was read is one that was written, which may differ by `within`."""
    return abs(read - written) <= within + _ROUNDING * abs(written)


def as_written(read: float, written: str | None, within: float = 0.0) -> str:
    """Return the text of a number that was read: that of the command `written`, if it is the same number."""
    return written if written and is_near(read, float(written), within) else f"{read:.15e}"


def repeats(held: float, scale: float, offset: float, written: float) -> bool:
    """Return whether ``held * scale + offset`` is a number that was written elsewhere: a whole number that is
    held rounds it by half a step."""
    step = 0.0 if isinstance(held, float) else 0.5 * abs(scale)
    return is_near(held * scale + offset, written, step)
