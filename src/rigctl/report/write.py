"""Make the report of one or more runs.

In: runs, and sections that other parts of rigctl have made about them. Out: one HTML file that needs no
other, and on request each of its plots as a file. The page is put together in memory and written in one
step, so that an earlier one is replaced by a complete one or not at all.

It begins with the answer. What a run or an analysis has shown comes first, and the evidence is folded behind
it; only how a run failed comes before any analysis of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rigctl.argument_types import checks_argument_types
from rigctl.dataset import Run
from rigctl.dataset.outputs import is_figure, is_page, require_output, require_outputs
from rigctl.errors import RigctlError, unknown_name
from rigctl.files.write import write_text
from rigctl.report.heat_map import HeatMap, write_heat_map
from rigctl.report.page import page
from rigctl.report.plot import Plot
from rigctl.report.run_data import RunData, read_run
from rigctl.report.section import Section
from rigctl.report.sections import SECTIONS
from rigctl.report.sections.outcome import ended_well
from rigctl.tasks import counted


@dataclass(frozen=True)
class Report:
    """A written report."""

    page: Path
    figures: tuple[Path, ...]
    runs: tuple[str, ...]
    size: int  #: size of the page, bytes

    def summary(self) -> str:
        """One sentence for a person."""
        figures = f" and {len(self.figures)} figures" if self.figures else ""
        return f"{self.page.as_posix()} ({self.size / 1e6:.1f} MB){figures}"


@checks_argument_types
def write_report(
    runs: Sequence[Run],
    output: str | Path,
    *,
    figures: str | Path | None = None,
    form: str = "png",
    sections: Sequence[Section] = (),
    force: bool = False,
    on_progress: Callable[[str], None] = lambda _: None,
) -> Report:
    """Write one self-contained HTML page about the runs, completely or not at all.

    Parameters
    ----------
    output: the page's file; an earlier page is replaced.
    figures: a folder for every plot as a separate file.
    form: of these, ``png`` or ``svg``.
    sections: sections from other parts of rigctl about these runs; shown after the outcome.
    force: replace any existing file, except those of a run.
    on_progress: called with a description of each step.

    Raises
    ------
    RigctlError
        no run was given, a run's file is damaged, another file is in the way, or a file cannot be written.
    """
    from rigctl.report.figure_files import FORMATS

    # What can be refused is refused before any run is read.
    if form not in FORMATS:
        raise unknown_name("format of figures", form, FORMATS)
    output = Path(output)
    require_output(output, replaces=is_page, force=force)
    if not runs:
        raise RigctlError("a report needs at least one run")
    # All of the page is made in memory before anything is written, so that a damaged run leaves the page of
    # before in place.
    data = [read_run(run) for run in counted(runs, "Reading the runs", on_progress)]
    on_progress(f"Writing {output.as_posix()}")
    parts = assemble(data, sections)
    html = page(data, parts)
    drawn: tuple[Path, ...] = ()
    if figures is not None:
        figures = Path(figures)
        files = [figures / f"{plot.id}.{form}" for part in parts for plot in part.plots]
        require_outputs(files, replaces=is_figure, force=force)
    # The page first, so that an error while figures are drawn does not cost it.
    write_text(output, html)
    if figures is not None:
        plots = [plot for part in parts for plot in part.plots]
        drawn = tuple(_draw(plot, figures, form) for plot in counted(plots, "Drawing figures", on_progress))
    return Report(output, drawn, tuple(run.id for run in data), output.stat().st_size)


def _draw(plot: Plot | HeatMap, folder: Path, form: str) -> Path:
    from rigctl.report.figure_files import write_figure

    return (
        write_heat_map(plot, folder, form) if isinstance(plot, HeatMap) else write_figure(plot, folder, form)
    )


def assemble(runs: Sequence[RunData], sections: Sequence[Section] = ()) -> list[Section]:
    """The page's sections: the answer first, then its evidence.

    The answer is the contributed section; without one it is how the run ended, and its results. For a failed
    run this comes before everything else. Sections for only some readers are folded.
    """
    # Each section decides by itself whether these runs have anything for it.
    run_sections = [section for build in SECTIONS if (section := build(runs)) is not None]
    if not sections:
        return run_sections
    # What happened to a run that did not end well comes before any analysis of it.
    first, rest = (
        (run_sections[:1], run_sections[1:])
        if any(not ended_well(run) for run in runs)
        else ([], run_sections)
    )
    behind = [replace(one, folded=True) for one in rest]
    answers = [one for one in sections if not one.closes]
    return [*first, *answers, *behind, *(one for one in sections if one.closes)]
