"""From a table, or only the name of a template, to the text of four files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rigctl.errors import unknown_name
from rigctl.proposal.choice import Suggestion, suggest
from rigctl.proposal.columns import Column, Table
from rigctl.proposal.draft import Draft
from rigctl.proposal.from_columns import duration, given
from rigctl.proposal.log_format import log_format_text
from rigctl.proposal.templates import TEMPLATES
from rigctl.proposal.write import family_text, model_text, procedure_text, rig_text


@dataclass(frozen=True)
class Proposal:
    """A proposal.

    Attributes
    ----------
    template: None if an FMU is the model.
    suggestion: what simple linear systems explain of the log; None if that is not asked.
    files: text by path, relative to the project.
    fmu: its path, as the family file names it.
    notes: what the user has to know or to fill in, a sentence each.
    """

    name: str
    template: str | None
    table: Table
    draft: Draft
    suggestion: Suggestion | None
    files: Mapping[str, str]
    fmu: str | None = None
    notes: tuple[str, ...] = ()

    @property
    def family(self) -> str:
        """The path of the family file, relative to the project; the others likewise."""
        return path_of("family", self.name)

    @property
    def rig(self) -> str:
        """The path of the rig file."""
        return path_of("rig", self.name)

    @property
    def model(self) -> str:
        """The path of the model file."""
        return path_of("model", self.name)

    @property
    def procedure(self) -> str:
        """The path of the procedure."""
        return path_of("procedure", self.name)


def path_of(kind: str, name: str) -> str:
    """The path of a file of a bench, relative to the project."""
    return f"{FOLDERS[kind]}/{name}.yaml"


def find_template(name: str) -> str:
    """`name`, if there is such a template.

    Raises
    ------
    RigctlError
        there is none; it says the nearest.
    """
    if name not in TEMPLATES:
        raise unknown_name("template", name, TEMPLATES)
    return name


def empty_table(template: str) -> Table:
    """The columns that a template has without a file."""
    columns = tuple(
        Column(name, name, unit, np.empty(0), role=role, stepped=True, origin="commanded")  # type: ignore[arg-type]
        for name, unit, role, _ in TEMPLATES[template].columns
    )
    return Table(None, columns, None, np.empty(0, dtype=np.int64))


def propose(name: str, table: Table, template: str | None) -> Proposal:
    """The files for a table; without a template the simplest that explains it.

    Raises
    ------
    RigctlError
        the table lacks what the template needs.
    """
    suggestion = suggest(table)
    chosen = template or suggestion.template
    draft = _with_every_input(TEMPLATES[chosen].make(table), table)
    source = f"the template {chosen}" + (f", first values from {table.path.name}" if table.path else "")
    files = file_texts(name, table, draft, family_text(name, draft, source, table))
    return Proposal(name, chosen, table, draft, suggestion, files)


def file_texts(name: str, table: Table, draft: Draft, family: str) -> dict[str, str]:
    """The texts by path; `family` is the text of the family file."""
    paths = {kind: path_of(kind, name) for kind in FOLDERS}
    log_format = log_format_text(paths["log format"], table)
    files = {
        paths["family"]: family,
        paths["rig"]: rig_text(
            name, table, draft, paths["family"], paths["log format"] if log_format else None
        ),
        paths["model"]: model_text(draft, paths["family"], paths["rig"]),
        paths["procedure"]: procedure_text(name, table, paths["rig"], duration(table)),
    }
    if log_format is not None:
        files[paths["log format"]] = log_format
    return files


def _with_every_input(draft: Draft, table: Table) -> Draft:
    """The draft with those inputs that its equations do not contain: an effect may depend on them."""
    other = [one for one in table.columns if one.role == "input" and one.name not in draft.inputs]
    unused = {
        name: replace(one, meaning=f"{one.meaning}; in no equation yet, but an effect may depend on it")
        for name, one in given(other, late=False).items()
    }
    return replace(draft, inputs={**draft.inputs, **unused}) if unused else draft


FOLDERS = {
    "family": "families",
    "rig": "rigs",
    "model": "models",
    "procedure": "procedures",
    "log format": "log-formats",
}
