"""The location of the files that come with rigctl: procedures, rigs, models and measured data."""

from __future__ import annotations

from pathlib import Path

import rigctl.errors as ground


def shipped(*parts: str) -> Path:
    """Return the path of a shipped file or folder, e.g. ``shipped("rigs", "hl32-bench.yaml")``.

    In an installed package they are in ``rigctl/shipped``, in a checkout in the folders of the repository.
    """
    package = Path(ground.__file__).parent
    installed = package / "shipped"
    root = installed if installed.is_dir() else package.parents[1]
    return root.joinpath(*parts)
