"""Report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rigctl.web.site import Part, Site

if TYPE_CHECKING:
    from starlette.routing import BaseRoute


def routes(site: Site) -> Sequence[BaseRoute]:
    """What the page asks for."""
    return ()


PART = Part("report", "Report", "What one or more runs have shown.", routes)
