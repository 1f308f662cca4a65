"""Adds the documentation site to a wheel; an editable installation gets it in ``build/site`` of its checkout."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class SiteHook(BuildHookInterface):  # type: ignore[type-arg, misc]
    """Builds the site and adds it to the other shipped files."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        sys.path.insert(0, str(Path(self.root) / "tools"))
        from make_site import make_site

        if version == "editable":
            try:
                make_site(Path(self.root) / "build" / "site")
            except (OSError, subprocess.CalledProcessError) as error:  # the program works without its pages
                self.app.display_warning(f"installed without the documentation: {error}")
            return

        # a folder of its own: another process may be reading or making the site of the checkout
        self.folder = tempfile.TemporaryDirectory(prefix="rigctl-wheel-")
        site = Path(self.folder.name) / "site"
        make_site(site)
        build_data["force_include"][str(site)] = "rigctl/shipped/site"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        if version != "editable":
            self.folder.cleanup()
