"""The contract of every bench: simulated, on the emulated board, and with real protocols."""

from __future__ import annotations

import pytest

from backends.contract.subjects import Subject
from rigctl.testing.contract import BackendContract


class TestEveryBackend(BackendContract):
    """The tests that packages with backends run too, for each of rigctl's own."""

    @pytest.fixture(autouse=True)
    def _made(self, subject: Subject) -> None:
        self._subject = subject

    def subject(self) -> Subject:
        return self._subject
