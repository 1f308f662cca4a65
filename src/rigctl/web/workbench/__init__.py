"""The workbench: a model and runs, its parameters as sliders, its effects as switches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rigctl.web.server_state import PagePart, Site

if TYPE_CHECKING:
    from starlette.routing import BaseRoute


def routes(site: Site) -> Sequence[BaseRoute]:
    """The routes of the page."""
    from rigctl.web.workbench.routes import workbench_routes

    return workbench_routes(site)


PART = PagePart("workbench", "Workbench", "A model against measurements, live.", routes)
