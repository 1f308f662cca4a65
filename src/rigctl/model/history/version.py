"""One version of a model: its number, its date, the change that made it, and its values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import Field, TypeAdapter

from rigctl.model.history.change import CHANGE, Change, Note


@dataclass(frozen=True)
class VersionValue:
    """A value stated by a version, in `unit`; for a temperature scale, `std` is in kelvin."""

    value: float
    unit: str
    std: float | None
    fit: bool
    source: Annotated[Note, Field(alias="from")]


_VALUES: Final = TypeAdapter(Mapping[str, VersionValue])


@dataclass(frozen=True)
class Version:
    """A version of the model file `head`.

    Attributes
    ----------
    number: counts from 1.
    time: when it was kept; for a file not kept yet, when it was written.
    done: the change from version `parent`.
    file: its path.
    kept: False for a file that is not yet a version: it is kept as soon as something changes it.
    values: stated in its file, effects' parameters under their qualified names.
    sha256: of its text, line ends aside.
    """

    number: int
    time: datetime
    done: Change
    head: Path
    file: Path
    sha256: str
    parent: int | None = None
    kept: bool = True
    values: Mapping[str, VersionValue] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """The JSON document, also that of the version's own file."""
        return {
            "version": self.number,
            "parent": self.parent,
            "time": self.time.isoformat(),
            **self.done.document(),
            "values": _VALUES.dump_python(self.values, mode="json", by_alias=True),
            "file": self.head.name,
            "sha256": self.sha256,
        }

    @staticmethod
    def of_document(written: Mapping[str, Any], head: Path, file: Path) -> Version:
        """The version described by a result of `document`."""
        return Version(
            number=written["version"],
            parent=written["parent"],
            time=datetime.fromisoformat(written["time"]),
            done=CHANGE.validate_python(written),
            head=head,
            file=file,
            sha256=written["sha256"],
            values=_VALUES.validate_python(written["values"]),
        )
