"""How the blocks of an answer are drawn on a page: one template for each kind of block."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from markupsafe import Markup

from rigctl.answers.blocks import Block, Figure, is_empty
from rigctl.report.section import render


def page_blocks(blocks: Iterable[Block], figures: Mapping[str, Markup] | None = None) -> Markup:
    """The blocks as HTML, one below another.

    Parameters
    ----------
    figures: drawn plots by the keys of their blocks; a figure that was not drawn is left out.
    """
    drawn = figures or {}
    return Markup().join(
        render(f"blocks/{type(block).__name__.casefold()}.html", block=block, figures=drawn, page=page_blocks)
        for block in blocks
        if not is_empty(block) and (not isinstance(block, Figure) or block.key in drawn)
    )
