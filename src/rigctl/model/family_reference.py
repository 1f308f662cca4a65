"""How a file refers to the family of a model: a shipped one by name, a user's by the path of its file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from rigctl.files.yaml import parse_document
from rigctl.model.model import Model
from rigctl.physics.families import is_family_file
from rigctl.project import find_project


def family_reference(model: Model, folder: Path) -> str:
    """The reference to the family of `model` in a file in `folder`."""
    if model.path is None or not model.text:
        return model.family.name
    content = parse_document(model.text, model.path).data
    written = content.get("model") if isinstance(content, Mapping) else None
    if not isinstance(written, str) or not is_family_file(written):
        return model.family.name
    path = find_project(model.path.parent).resolve(written, relative_to=model.path).resolve()
    try:
        return Path(os.path.relpath(path, folder.resolve())).as_posix()
    except ValueError:  # another drive
        return path.as_posix()
