"""Verifies a run in storage by reading it back."""

from __future__ import annotations

from rigctl.dataset.storage.store import StoredFolder
from rigctl.dataset.verification import Condition, Verification
from rigctl.errors import RigctlError


def verify_stored(folder: StoredFolder) -> Verification:
    """Compare every object of a run with the checksum in its ``run.json``, without changes.

    Raises
    ------
    RigctlError
        the storage does not respond, or refuses.
    """
    try:
        known = folder.info.get("files", {})
    except RigctlError as problem:
        return Verification(folder.name, folder, Condition.BROKEN, tuple(str(problem).splitlines()))
    problems = []
    for name, facts in known.items():
        found = (folder / name).facts()
        if found is None:
            problems.append(f"{folder / name}: the object is missing")
        elif found != facts:
            said = f"{facts['bytes']} bytes then, {found['bytes']} now"
            problems.append(f"{folder / name}: the object is not what the run was closed with ({said})")
    condition = Condition.BROKEN if problems else Condition.WHOLE
    return Verification(folder.name, folder, condition, tuple(problems))
