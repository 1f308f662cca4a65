"""The error of a model from version to version."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rigctl.model.history.change import ModelError
from rigctl.model.history.version import Version


@dataclass(frozen=True)
class VersionError:
    """The error of a version, and the runs that it refers to, with their held-out and selected records."""

    version: Version
    error: ModelError
    runs: tuple[str, ...]
    hold_out: str
    only: str
    assume: tuple[str, ...]


def version_errors(versions: Sequence[Version]) -> tuple[VersionError, ...]:
    """The errors of the versions, as far as known: each after the change that made the version.

    For a version made by hand, it is the error before the change that made the first version derived from it.
    """
    first_child: dict[int, Version] = {}
    for version in versions:
        if version.parent is not None and version.done.before is not None:
            first_child.setdefault(version.parent, version)
    errors = []
    for version in versions:
        child = first_child.get(version.number)
        if version.done.after is not None:
            errors.append(_error(version, version.done.after, version))
        elif child is not None and child.done.before is not None:
            errors.append(_error(version, child.done.before, child))
    return tuple(errors)


def _error(version: Version, error: ModelError, source: Version) -> VersionError:
    change = source.done
    return VersionError(version, error, change.runs, change.hold_out, change.only, change.assume)
