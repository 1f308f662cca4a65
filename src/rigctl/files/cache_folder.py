"""Where what can be made again is kept between commands."""

from __future__ import annotations

import os
from pathlib import Path

#: names another place than the user's own
CACHE_VARIABLE = "RIGCTL_CACHE_DIR"


def cache_folder() -> Path:
    """The folder for it: what the variable says, else the system's for this user."""
    from platformdirs import user_cache_path

    chosen = os.environ.get(CACHE_VARIABLE)
    return Path(chosen) if chosen else user_cache_path("rigctl", appauthor=False)
