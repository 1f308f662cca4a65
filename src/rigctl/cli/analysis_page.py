"""A comparison or a diagnosis as a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.cli.echo import echo

if TYPE_CHECKING:
    from rigctl.analysis.comparison_result import Comparison, ModelComparison
    from rigctl.dataset import Run
    from rigctl.model import Model
    from rigctl.report.analysis.page_top import NamedModels
    from rigctl.report.section import Section

#: most earlier versions of a model that are fitted again for a page: the first and the newest
_MOST_EARLIER = 5


def require_page(output: Path | None, *, force: bool) -> None:
    """Refuse a page's path before any work is done, if another file would be lost.

    Raises
    ------
    RigctlError
        as `rigctl.dataset.outputs.require_output`.
    """
    from rigctl.dataset.outputs import is_page, require_output

    if output is not None:
        require_output(output, replaces=is_page, force=force)


def write_page(
    runs: Sequence[Run], output: Path, sections: Sequence[Section], *, force: bool = False
) -> None:
    """Write the runs' page with these sections, and print its path.

    Raises
    ------
    RigctlError
        the page cannot be written.
    """
    from rigctl.report import write_report

    written = write_report(runs, output, sections=sections, force=force)
    echo(f"Wrote {written.summary()}", err=True)


def compare_with_versions(
    runs: Sequence[Run], models: Sequence[Model], *, earlier: bool = True, **choice: Any
) -> tuple[Comparison, list[ModelComparison]]:
    """The compared models; for a single model also its versions, in order.

    Parameters
    ----------
    earlier: False for the models alone.
    choice: as of `rigctl.analysis.comparison.compare`.

    Raises
    ------
    RigctlError
        as that does.
    """
    from dataclasses import replace

    from rigctl.analysis.comparison import compare
    from rigctl.model.history.save import load_version

    path = models[0].path if earlier and len(models) == 1 else None
    numbers = [] if path is None else _versions_with_errors(path)
    before = [] if path is None else [load_version(path, number) for number in numbers[:-1]]
    comparison = compare(runs, models, **choice)
    versions = [*compare(runs, before, **choice).models, comparison.models[0]] if before else []
    return comparison, [
        replace(one, name=f"version {number}") for one, number in zip(versions, numbers, strict=bool(before))
    ]


def named_versions(runs: Sequence[Run], path: Path, first: int, **choice: Any) -> NamedModels:
    """A model's version `first` and its head, fitted to the same runs; only the head if they are the same.

    Parameters
    ----------
    choice: as of `rigctl.analysis.fitting.read_runs`.

    Raises
    ------
    RigctlError
        as `rigctl.analysis.fitting.fit_to_data`.
    """
    from rigctl.analysis.fitting import fit_to_data, read_runs
    from rigctl.answers.findings.systematic_error import left_of_fit
    from rigctl.model.history.save import load_version
    from rigctl.model.history.store import current_version
    from rigctl.report.analysis.page_top import NamedModels

    numbers = list(dict.fromkeys((first, current_version(path).number)))
    models = [load_version(path, number) for number in numbers]
    data = read_runs(models[0], runs, **choice)
    fits = tuple(fit_to_data(model, data) for model in models)
    return NamedModels(tuple(f"version {number}" for number in numbers), fits, tuple(map(left_of_fit, fits)))


def _versions_with_errors(path: Path) -> list[int]:
    """The numbers of the versions with a known error, the head last; empty if there is no other."""
    from rigctl.files.version_suffix import split_version
    from rigctl.model.history.errors import version_errors
    from rigctl.model.history.store import current_version, versions

    if split_version(path)[1] is not None:  # a version that was requested by its number is shown alone
        return []
    head = current_version(path).number
    known = [one.version.number for one in version_errors(versions(path)) if one.version.number != head]
    few = known if len(known) <= _MOST_EARLIER else [known[0], *known[-_MOST_EARLIER + 1 :]]
    return [*few, head] if few else []
