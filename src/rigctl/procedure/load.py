"""Read a procedure file.

In: a file or a text. Out: a `Procedure`, whose every field is valid by itself, with the document that it
came from. What can only be judged with a rig (channels, limits, dimensions of variables) is judged by
`expand`.

The document is kept to the end: later messages give line and column in the user's file, and the text is
stored with each run. The rig is only a path here: a procedure that is only called by others names none,
and uses its caller's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path

from pydantic import Field

from rigctl.argument_types import checks_argument_types
from rigctl.errors import RigctlError
from rigctl.files.validate import validate
from rigctl.files.yaml import Document, parse_document, read_document
from rigctl.notebook import one_line
from rigctl.plan.arguments import Argument, ArgumentFields
from rigctl.plan.fields import Name
from rigctl.plan.identity import IdentityFields
from rigctl.plan.step import Cleanup
from rigctl.project import find_project
from rigctl.steps.registry import AnyStep
from rigctl.wording import number_of


class ProcedureFile(Cleanup):
    """A procedure file."""

    procedure: str = Field(min_length=1, max_length=100, description="its name")
    description: str = Field(default="", description="for reports")
    rig: str | None = Field(
        default=None,
        description="the rig file; not needed in a procedure that is only called, which uses its caller's",
    )
    identity: IdentityFields = Field(
        default=IdentityFields(),
        description="the device under test and the person in charge: known values, and those that must "
        "be given; ignored in a called procedure",
    )
    arguments: dict[Name, Argument] = Field(
        default_factory=dict, description="values that a call or --arg may give; used as $name"
    )
    steps: list[AnyStep] = Field(min_length=1, description="executed in this order")


ProcedureFile.model_rebuild(_types_namespace={"AnyStep": AnyStep})


@dataclass(frozen=True)
class Procedure:
    """A procedure file that has been read and found valid; `expand` makes it a plan for a rig."""

    file: ProcedureFile
    document: Document = field(repr=False)

    def __repr__(self) -> str:
        """The name and the number of steps, on one line."""
        return one_line(self, f"{self.name}: {number_of(len(self.steps), 'step')}")

    @property
    def name(self) -> str:
        """The procedure's name."""
        return self.file.procedure

    @property
    def path(self) -> Path | None:
        """The file it was read from."""
        return self.document.path

    @property
    def text(self) -> str:
        """The file's text, which is stored with every run."""
        return self.document.text

    @cached_property
    def sha256(self) -> str:
        """The hash of the text, as hexadecimal digits."""
        return sha256(self.text.encode("utf-8")).hexdigest()

    @property
    def arguments(self) -> Mapping[str, ArgumentFields]:
        """Its arguments by name."""
        return self.file.arguments

    @property
    def identity(self) -> IdentityFields:
        """Its fields for the device under test; ignored if it is called by another procedure."""
        return self.file.identity

    @property
    def steps(self) -> Sequence[AnyStep]:
        """Its steps."""
        return self.file.steps

    @property
    def on_failure(self) -> Sequence[AnyStep]:
        """The steps that are executed after a failure."""
        return self.file.on_failure or ()

    @property
    def on_abort(self) -> Sequence[AnyStep]:
        """The steps that are executed after an abort."""
        return self.file.on_abort or ()

    @property
    def finally_(self) -> Sequence[AnyStep]:
        """The steps that are executed last, in every case."""
        return self.file.finally_ or ()

    @property
    def rig_path(self) -> Path:
        """The rig file that it names, relative to its own folder or to the project, or a shipped one.

        Raises
        ------
        RigctlError
            it names none, or there is no such file.
        """
        where = self.document.locate(("rig",))
        if self.file.rig is None:
            raise RigctlError(
                "this procedure names no rig", expected="'rig: rigs/….yaml' or --rig", where=where
            )
        try:
            project = find_project(self.path.parent if self.path else None)
            return project.resolve(self.file.rig, relative_to=self.path)
        except RigctlError as error:
            error.what = f"rig: {error.what}"
            raise error.at(where) from None


@checks_argument_types
def load_procedure(path: str | Path) -> Procedure:
    """The procedure that a file describes.

    Raises
    ------
    RigctlError
        the file cannot be read, or something in it is wrong; with the location.
    """
    return _build(read_document(Path(path)))


def parse_procedure(text: str, path: Path | None = None, *, generated: bool = False) -> Procedure:
    """Return the procedure that a text describes, e.g. that stored with a run; `path` names it in messages.

    Messages about a `generated` one have no line and column.

    Raises
    ------
    RigctlError
        as `load_procedure`.
    """
    return _build(replace(parse_document(text, path), generated=generated))


def _build(document: Document) -> Procedure:
    return Procedure(validate(document, ProcedureFile), document)
