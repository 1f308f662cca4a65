"""Keep a changed model as the next version of its file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from rigctl.errors import ExitCode, Location, RigctlError
from rigctl.files.version_suffix import split_version, with_version
from rigctl.files.write import write_text
from rigctl.files.yaml import read_document
from rigctl.model.history import store
from rigctl.model.history.change import Change
from rigctl.model.history.version import Version, VersionValue
from rigctl.model.load import load_model, parse_model
from rigctl.model.model import Model
from rigctl.model.value_table import stated_values
from rigctl.model.writing.update import updated_text

#: time-out for another program that is keeping a version, s
_PATIENCE = 30.0


def load_version(path: Path, number: int) -> Model:
    """Version `number` of the model file `path`: `load_model` of ``path@number``.

    Raises
    ------
    RigctlError
        there is no such version, or as `load_model`.
    """
    return load_model(with_version(split_version(Path(path))[0], number))


def save_version(
    model: Model,
    path: Path,
    done: Change,
    *,
    effect_files: Sequence[Path] = (),
    now: datetime | None = None,
) -> Version:
    """Write the next version of a model file, and make it the head.

    The new text is the one from which `model` was read, updated to describe `model`. A file that was edited
    by hand since its last version is first kept as a version of its own, so that nothing is ever lost, and no
    version is ever changed: two programs that do this at once make two versions.

    Parameters
    ----------
    model: read with `load_model` and changed.
    path: its file, or ``m.yaml@3`` if `model` was derived from version 3.
    done: the change.
    effect_files: of the user's own effects that are new in `model`.
    now: the time to be recorded; by default that of the call.

    Raises
    ------
    RigctlError
        the folder cannot be written to, another program does not finish, or as `updated_text`.
    """
    head, _ = split_version(Path(path))
    time = now or datetime.now(UTC)
    # before anything is kept: a file that cannot be changed leaves no trace
    text = updated_text(model, head, effect_files)
    with _alone(head):
        # in this order: the text that was changed, what somebody has made of it meanwhile, and then the
        # change, whose parent is the former
        _keep(head, model.text, time)
        _keep(head, read_document(head).text, time)
        kept = store.read_versions(head)
        parents = [version.number for version in kept if version.sha256 == store.digest(model.text)]
        version = _write(head, text, done, parents[-1], time)
        write_text(head.resolve(), text)
    return version


def _keep(head: Path, text: str, time: datetime) -> None:
    """Keep a text that is not yet a version, as edited by its user."""
    kept = store.read_versions(head)
    differs = store.change_since(text, kept)
    if differs is not None:
        _write(head, text, *differs, time)


def _write(head: Path, text: str, done: Change, parent: int | None, time: datetime) -> Version:
    number = store.next_number(head)
    version = Version(
        number=number,
        time=time,
        done=done,
        head=head,
        file=store.version_file(head, number),
        sha256=store.digest(text),
        parent=parent,
        values=_values(parse_model(text, head)),
    )
    store.write_version(version, text)
    return version


def _values(model: Model) -> dict[str, VersionValue]:
    """The values in the file, without those left to the rig or the library."""
    return {
        stated.name: VersionValue(stated.value, stated.unit, stated.std_value, stated.fit, stated.source)
        for stated in stated_values(model)
        if stated.origin == "model"
    }


@contextmanager
def _alone(head: Path) -> Iterator[None]:
    """Hold the lock with which only one program at a time keeps a version of this file."""
    from filelock import FileLock, Timeout

    folder = store.folder_of(head)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / "lock", timeout=_PATIENCE)
        lock.acquire()
    except Timeout as problem:
        raise RigctlError(
            "another program is changing this model",
            where=Location(head),
            hint="Try again when it is done",
            exit_code=ExitCode.FAILED,
        ) from problem
    except OSError as problem:
        raise RigctlError(
            f"cannot write to the folder of versions: {problem.strerror or problem}",
            where=Location(folder),
            exit_code=ExitCode.FAILED,
        ) from problem
    try:
        yield
    finally:
        lock.release()
