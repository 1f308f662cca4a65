"""Reads the parts of a document one by one, and collects all errors with their locations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from rigctl.errors import RigctlError, SeveralErrors
from rigctl.files.nodes import Key
from rigctl.files.yaml import Document

T = TypeVar("T")


class Reader:
    """Collects the errors of one document, so that they can be corrected together."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.errors: list[RigctlError] = []

    def read(self, keys: Sequence[Key], read: Callable[[], T], *, of_key: bool = False) -> T | None:
        """Return the result of `read`; if it refuses the value under `keys`, record the error instead."""
        try:
            return read()
        except RigctlError as error:
            self.refuse(keys, error, of_key=of_key)
            return None

    def refuse(self, keys: Sequence[Key], error: RigctlError, *, of_key: bool = False) -> None:
        """Record an error in the value under `keys`, or in the key itself."""
        self.errors.append(error.at(self.document.locate(tuple(keys), of_key=of_key)))

    def stop_at_errors(self) -> None:
        """Raise the errors so far, if any.

        Raises
        ------
        RigctlError
            the error; `SeveralErrors` if there is more than one.
        """
        if self.errors:
            raise self.errors[0] if len(self.errors) == 1 else SeveralErrors(self.errors)
