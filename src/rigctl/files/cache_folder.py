"""The folder for reproducible results that are kept between commands."""

from __future__ import annotations

import os
from pathlib import Path

#: environment variable for another folder
CACHE_VARIABLE = "RIGCTL_CACHE_DIR"


def cache_folder() -> Path:
    """The folder: from the variable, or else the system's cache folder for this user."""
    from platformdirs import user_cache_path

    chosen = os.environ.get(CACHE_VARIABLE)
    return Path(chosen) if chosen else user_cache_path("rigctl", appauthor=False)
