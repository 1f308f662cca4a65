"""A rig whose channels take any number: for tests of how numbers are read, whatever a sensor can measure."""

from __future__ import annotations

from pathlib import Path

from rigctl.rig import Rig, load_rig


def without_ranges(path: Path) -> Rig:
    """The rig of a file, with no range for any channel: no reading is impossible."""
    rig = load_rig(path)
    channels = {name: one.model_copy(update={"range": None}) for name, one in rig.channels.items()}
    return rig.model_copy(update={"channels": channels})
