"""Uploads a closed run to storage, with checksums, retries and continuation.

In: a run's folder and an address. Out: the same files there. A run appears in the storage only with its
``run.json``, which is sent last, so that an upload that was cut off is no run, and can simply be
repeated: what is there with the right checksum is not sent again. Ids are given by each computer, so that
two different runs may have the same one; the reservation, made before anything is sent, decides which of
them has it.
"""

from __future__ import annotations

import hashlib
import json
import logging
import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rigctl.dataset import run_json
from rigctl.dataset.recording import journal
from rigctl.dataset.recording.writer_lock import ANNOTATIONS_LOCK_NAME, LOCK_NAME, STATE_NAME, in_progress
from rigctl.dataset.storage.store import StorageSilent, Store, StoredFile, StoredFolder
from rigctl.errors import ExitCode, Location, RigctlError

logger = logging.getLogger(__name__)

#: attempts per file, and the delay before a retry, s, which doubles each time
_ATTEMPTS: Final = 3
_PAUSE: Final = 0.5
#: files that are local to the computer that wrote the run
_LEFT: Final = (LOCK_NAME, ANNOTATIONS_LOCK_NAME, STATE_NAME)
#: fields by which a run in storage is recognised as an earlier state of the same run
_SAME: Final = ("id", "started", "plan_digest", "backend", "layout")
#: object with the SHA-256 of these fields: sent first, so that only one run is sent to a folder
_RESERVED: Final = ".reserved"


@dataclass(frozen=True)
class Uploaded:
    """The result: numbers of files that were sent, and that already existed intact."""

    run: str
    address: str
    sent: int
    there: int


def upload(folder: Path, store: Store) -> Uploaded:
    """Upload a closed run; a repeated call sends only missing files, and those changed by annotations.

    ``run.json`` is sent last, since it makes the run visible. Each file is read back and compared.

    Raises
    ------
    RigctlError
        the run is open or incomplete, or storage has another run of this name, refuses, stalls, or stores
        different data. The local run is unchanged.
    """
    info = _closed(folder)
    stored = store.folder(folder.name)
    # First by what is there already; a run that is not there is reserved, as another may be on its way.
    if not _require_same(info, stored):
        _reserve(info, stored)
    files = sorted(path for path in folder.iterdir() if path.is_file() and _belongs(path.name))
    files.sort(key=lambda path: path.name == run_json.NAME)
    sent = sum(_send(path, stored / path.name, info) for path in files)
    return Uploaded(folder.name, str(stored), sent, len(files) - sent)


def _belongs(name: str) -> bool:
    return not name.startswith(".") and name not in _LEFT


def _closed(folder: Path) -> dict[str, Any]:
    info = run_json.read_info(folder)
    if info["status"] == run_json.RUNNING or (folder / journal.NAME).exists():
        raise RigctlError(
            "the run is still in progress" if in_progress(folder) else "the run was never closed",
            value=folder.name,
            hint=f"'rigctl runs verify {folder.name}' recovers one that was left behind",
        )
    return info


def _require_same(info: dict[str, Any], stored: StoredFolder) -> bool:
    """Refuse to overwrite another run, since each computer assigns ids independently.

    Returns whether this run is there already.
    """
    infos = stored.store.infos([stored.name])
    _, known = infos.get(stored.name, (0, None))
    if stored.name in infos and known is None:
        return False  # damaged in transit: sent again
    if known is not None and any(known.get(key) != info.get(key) for key in _SAME):
        raise _another(stored)
    return known is not None


def _reserve(info: dict[str, Any], stored: StoredFolder) -> None:
    """Reserve the name for this run: two that are sent at once would overwrite each other's files."""
    identity = _identity(info)
    reservation = (stored / _RESERVED).create(identity)
    if re.fullmatch(rb"[0-9a-f]{64}", reservation) is None:
        raise StorageSilent(
            f"storage has other data than were sent as {_RESERVED}",
            hint="Is it a storage that answers, or the login page of a network? The run is whole here",
            where=Location(str(stored)),
            exit_code=ExitCode.FAILED,
        )
    if reservation != identity:
        raise _another(stored)


def _identity(info: dict[str, Any]) -> bytes:
    facts = {key: info.get(key) for key in _SAME}
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode("utf-8")).hexdigest().encode("ascii")


def _another(stored: StoredFolder) -> RigctlError:
    return RigctlError(
        "storage has another run of this name",
        value=str(stored),
        hint="Recorded runs are never overwritten; give this bench a separate address",
        exit_code=ExitCode.FAILED,
    )


def _send(path: Path, stored: StoredFile, info: dict[str, Any]) -> bool:
    """Send a file unless it exists; return whether it was sent."""
    known = run_json.file_facts(path)
    # What has changed since the run was closed is not spread further.
    if info["files"].get(path.name, known) != known:
        raise RigctlError(
            "the file has changed since the run was closed: it is not sent",
            where=Location(path),
            hint=f"'rigctl runs verify {path.parent.name}' says what is broken",
            exit_code=ExitCode.FAILED,
        )
    if stored.size() == known["bytes"] and stored.facts() == known:
        return False
    problem: RigctlError | None = None
    for attempt in range(_ATTEMPTS):
        if attempt:
            time.sleep(_PAUSE * 2.0 ** (attempt - 1))
        try:
            stored.send(str(path))
            # Read back: storage that confirms is not storage that has stored.
            facts = stored.facts()
        except RigctlError as error:
            problem = error
            continue
        if facts == known:
            return True
        problem = RigctlError(
            f"storage has different data than were sent as {path.name}",
            value="nothing" if facts is None else f"{facts['bytes']} bytes",
            expected=f"{known['bytes']} bytes, SHA-256 {known['sha256'][:12]}…",
            hint="The run is whole here; 'rigctl runs upload' tries again",
            exit_code=ExitCode.FAILED,
        )
    assert problem is not None  # noqa: S101 - there was at least one attempt
    raise problem


def upload_if_wanted(folder: Path) -> None:
    """Upload a run that has just been closed to the storage of its project, if there is one.

    A failure is only reported: the local run is complete and can be uploaded later.
    """
    from rigctl.project import find_project

    address = find_project(folder).store
    if address is None:
        return
    try:
        done = upload(folder, Store(address))
    except RigctlError as error:
        logger.warning("%s is kept in %s and not uploaded: %s", folder.name, folder, error)
        logger.warning("'rigctl runs upload' tries again")
    else:
        logger.info("%s: %d files sent to %s", done.run, done.sent, done.address)
