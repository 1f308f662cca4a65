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
        actual = (folder / name).facts()
        if actual is None:
            problems.append(f"{folder / name}: the object is missing")
        elif actual != facts:
            sizes = f"{facts['bytes']} bytes then, {actual['bytes']} now"
            problems.append(f"{folder / name}: the object is not what the run was closed with ({sizes})")
    condition = Condition.BROKEN if problems else Condition.WHOLE
    return Verification(folder.name, folder, condition, tuple(problems))
