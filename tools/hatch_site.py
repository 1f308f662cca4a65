"""Adds the documentation site to a wheel, for `make wheel`.

Not by default: an installation from a checkout would need the site's builder, and has `make site`.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class SiteHook(BuildHookInterface):  # type: ignore[type-arg, misc]
    """Builds the site and adds it to the other shipped files."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if version == "editable":
            return
        sys.path.insert(0, str(Path(self.root) / "tools"))
        from make_site import make_site

        site = Path(self.root) / "build" / "site"
        make_site(site)
        build_data["force_include"][str(site)] = "rigctl/shipped/site"
