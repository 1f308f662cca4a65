"""The title of a model for readers: its file, and its version if it has several."""

from __future__ import annotations

from rigctl.files.version_suffix import split_version
from rigctl.model.model import Model


def model_title(model: Model) -> str:
    """``hl32-textbook.yaml``, with several versions ``…, version 2``; without a file its family."""
    from rigctl.model.history.store import current_version, versions

    if model.path is None:
        return model.family.name.replace("_", " ")
    head, number = split_version(model.path)
    if number is None:
        known = versions(head) if head.is_file() else []
        if len(known) < 2:
            return head.name
        number = current_version(head).number
    return f"{head.name}, version {number}"
