"""Read a rig file.

In: a file, or the text that was stored with a run. Out: a `Rig` that is valid as far as a file can tell, or
every mistake in it with line and column. Whether the bench is as the file says is for `rigctl doctor`.
"""

from __future__ import annotations

from pathlib import Path

from rigctl.argument_types import checks_argument_types
from rigctl.errors import RigctlError, SeveralErrors
from rigctl.files.validate import validate
from rigctl.files.yaml import Document, parse_document, read_document
from rigctl.rig.checks import problems
from rigctl.rig.rig import Rig


@checks_argument_types
def load_rig(path: str | Path) -> Rig:
    """The rig that a file describes, checked as far as a file can be.

    Raises
    ------
    RigctlError
        the file cannot be read, or something in it is wrong; with the location.
    """
    return _build(read_document(Path(path)))


def parse_rig(text: str, path: Path | None = None) -> Rig:
    """Return the rig that a text describes, e.g. that stored with a run; `path` names it in messages.

    Raises
    ------
    RigctlError
        as `load_rig`.
    """
    return _build(parse_document(text, path))


def _build(document: Document) -> Rig:
    # 1. Each field by itself, by the schema.
    rig = validate(document, Rig)
    # 2. The options of a plug-in by the class that the plug-in names: only now is it known which one.
    for keys, backend in rig.backends:
        if (reads := backend.plugin_class) is not None:
            if "options" not in backend.model_fields_set:
                error = RigctlError(
                    f"nothing says what the {backend.kind} backend reads", expected="'options:'"
                )
                raise error.at(document.locate(keys))
            validate(document, reads, keys=(*keys, "options"))
    # 3. What involves several fields. All of it is collected, and reported in the order of the file.
    found: list[RigctlError] = [
        problem.error.at(document.locate(problem.keys, of_key=problem.of_key)) for problem in problems(rig)
    ]
    if len(found) > 1:
        raise SeveralErrors(sorted(found, key=lambda error: (error.where.line or 0, error.where.column or 0)))
    if found:
        raise found[0]
    # The text goes with the rig: it is stored with each run, and `rigctl calibrate` changes it in place.
    return rig.written_in(document.path, document.text)
