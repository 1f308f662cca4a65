"""The versions of a model as data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rigctl.model.history.errors import version_errors
from rigctl.model.history.version import Version


def history_document(versions: Sequence[Version], current: Version) -> dict[str, Any]:
    """The versions of a model as data; `errors` are the known errors, by version, for a plot."""
    return {
        "model": current.head.as_posix(),
        "current": current.number,
        "versions": [{**version.document(), "kept": version.kept} for version in versions],
        "errors": [
            {
                "version": known.version.number,
                "runs": list(known.runs),
                "hold_out": known.hold_out or None,
                "only": known.only or None,
                "assume": list(known.assume),
                **known.error.document(),
            }
            for known in version_errors(versions)
        ],
    }
