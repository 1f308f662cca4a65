"""What a comparison or a diagnosis shows, as a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from rigctl.dataset import Run
    from rigctl.report.section import Section


def write_page(runs: Sequence[Run], output: Path, sections: Sequence[Section]) -> None:
    """Write the runs' page with these sections, and say where it is.

    Raises
    ------
    RigctlError
        the page cannot be written.
    """
    from rigctl.report import write_report

    written = write_report(runs, output, sections=sections)
    typer.echo(f"Wrote {written.summary()}", err=True)
