"""Storage of a model file's versions: ``.history/<stem>/001.yaml`` beside it, and a JSON file with each.

A version exists once both of its files do: a program that ends between the two leaves a number unused.
Nothing in the folder is ever changed; `find_version` refuses a file that has been.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from rigctl.errors import Location, RigctlError
from rigctl.files.regular import read_text
from rigctl.files.version_suffix import split_version
from rigctl.files.write import to_json, write_new
from rigctl.files.yaml import Document, read_document
from rigctl.json_values import parse_json
from rigctl.model.history.change import Change
from rigctl.model.history.version import Version

FOLDER: Final = ".history"
_NUMBER = re.compile(r"([0-9]{3,6})\.(yaml|json)")


def folder_of(head: Path) -> Path:
    """The folder that keeps the versions of the model file `head`."""
    return head.parent / FOLDER / head.stem


def digest(text: str) -> str:
    """SHA-256 of a text, independent of its line ends."""
    return hashlib.sha256(text.replace("\r\n", "\n").encode("utf-8")).hexdigest()


def versions(path: Path) -> tuple[Version, ...]:
    """The versions of a model file, the oldest first; a file that is not yet a version is the last of them.

    Raises
    ------
    RigctlError
        there is no such model file, or a version's description cannot be read.
    """
    head, _ = split_version(Path(path))
    kept = read_versions(head)
    return (*kept, *_head(head, kept))


def current_version(path: Path) -> Version:
    """The version of the current model file.

    Raises
    ------
    RigctlError
        as `versions`.
    """
    head, _ = split_version(Path(path))
    sha256 = digest(read_document(head).text)
    # by content, not by date: a file copied or checked out has another date
    kept = {version.sha256: version for version in versions(head)}  # the last of equal ones
    if sha256 not in kept:
        raise RigctlError("the file was changed while it was read", where=Location(head), hint="Try it again")
    return kept[sha256]


def read_versions(head: Path) -> tuple[Version, ...]:
    """The versions of `head` that are kept.

    Raises
    ------
    RigctlError
        a version's description cannot be read, or belongs to another model file.
    """
    folder = folder_of(head)
    result = tuple(
        _read(head, folder / f"{name}.json")
        for name in _names(folder)
        if (folder / f"{name}.json").exists() and (folder / f"{name}.yaml").exists()
    )
    return tuple(sorted(result, key=lambda version: version.number))


def find_version(path: Path, number: int) -> Version:
    """Version `number` of a model file.

    Raises
    ------
    RigctlError
        there is none; the message lists those that exist.
    """
    head, _ = split_version(Path(path))
    # the current file is a version too, but reading it may fail where the kept ones are sound: only if it is
    # asked for
    known = read_versions(head)
    if number not in {version.number for version in known}:
        known = versions(head)
    for version in known:
        if version.number == number:
            return version
    numbers = [str(version.number) for version in known]
    expected = f"1 to {numbers[-1]}" if len(numbers) > 1 else "only 1"
    raise RigctlError(
        "the model has no such version",
        value=str(number),
        expected=expected,
        where=Location(head),
        hint=f"'rigctl model history {head}' lists them",
    )


def read_version(head: Path, number: int) -> Document:
    """The text of version `number`, as it was kept.

    Raises
    ------
    RigctlError
        there is none, it cannot be read, or it was changed since.
    """
    version = find_version(head, number)
    document = read_document(version.file)
    if digest(document.text) != version.sha256:
        raise RigctlError(
            f"version {number} was changed after it was kept",
            where=Location(version.file),
            hint="Put the file back, or take another version",
        )
    return document


def write_version(version: Version, text: str) -> None:
    """Keep a version whose number is free.

    Raises
    ------
    RigctlError
        the folder cannot be written to.
    FileExistsError
        the number is taken.
    """
    # exclusively, and the description last: a version exists once both files do, and of two programs with the
    # same number the second one fails
    write_new(version.file, text.encode("utf-8"))
    write_new(version.file.with_suffix(".json"), (to_json(version.document()) + "\n").encode("utf-8"))


def next_number(head: Path) -> int:
    """A number that no file in the folder has."""
    return max((int(name) for name in _names(folder_of(head))), default=0) + 1


def version_file(head: Path, number: int) -> Path:
    """The path of version `number`."""
    return folder_of(head) / f"{number:03d}.yaml"


def change_since(text: str, kept: tuple[Version, ...]) -> tuple[Change, int | None] | None:
    """The change from the kept versions to `text`, and from which one; None if it is one of them."""
    if not kept:
        return Change("start"), None
    if digest(text) in {version.sha256 for version in kept}:
        return None
    return Change("edit"), kept[-1].number


def _head(head: Path, kept: tuple[Version, ...]) -> Iterator[Version]:
    """The current file as a version, if it is not the last one kept."""
    text = read_document(head).text
    differs = change_since(text, kept)
    if differs is not None:
        done, parent = differs
        written = datetime.fromtimestamp(head.stat().st_mtime, UTC)
        yield Version(next_number(head), written, done, head, head, digest(text), parent, kept=False)


def _names(folder: Path) -> list[str]:
    """The numbers for which there is a file, as they are written."""
    if not folder.is_dir():
        return []
    matches = (_NUMBER.fullmatch(file.name) for file in folder.iterdir())
    return sorted({match[1] for match in matches if match})


def _read(head: Path, file: Path) -> Version:
    try:
        written = parse_json(read_text(file))
        version, owner = Version.of_document(written, head, file.with_suffix(".yaml")), written["file"]
    except OSError as problem:
        raise RigctlError(
            f"cannot read the file: {problem.strerror or problem}", where=Location(file)
        ) from problem
    except (ValueError, LookupError, TypeError, AttributeError) as problem:
        raise RigctlError("this tells of no version of a model", where=Location(file)) from problem
    other = head.parent / owner
    # ``m.yaml`` and ``m.yml`` would share a folder; on Windows it may be the same file, named in another case
    if owner != head.name and other.exists() and not (head.exists() and other.samefile(head)):
        raise RigctlError(
            f"these are the versions of {owner}, which differs only in its ending",
            where=Location(file.parent),
            hint="Give one of the two another name",
        )
    return version
