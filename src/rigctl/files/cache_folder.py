"""The folder for reproducible results that are cached between commands."""

from __future__ import annotations

import os
from pathlib import Path

#: environment variable that sets another folder
CACHE_VARIABLE = "RIGCTL_CACHE_DIR"


def cache_folder() -> Path:
    """Return the folder: from the environment variable, or else the system's cache folder for this user."""
    from platformdirs import user_cache_path

    chosen = os.environ.get(CACHE_VARIABLE)
    return Path(chosen) if chosen else user_cache_path("rigctl", appauthor=False)
