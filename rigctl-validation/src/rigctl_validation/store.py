"""Results of the benchmark on disk: one JSON line for each finished scenario.

A line is written completely and flushed to disk before the next one starts, so that a kill at any moment
loses at most the scenarios in progress. A truncated line is skipped when the file is read again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic

from rigctl.errors import Location, RigctlError
from rigctl_validation.outcome import AnyTrial, TrialOutcome


@dataclass(frozen=True)
class ResultStore(Generic[AnyTrial]):
    """The results of one version of the tool in one file.

    Attributes
    ----------
    path: of the file; it and its folder are created with the first result.
    version: of the tool under test; results of other versions stay in the file and are ignored.
    read: makes a trial from plain data.
    """

    path: Path
    version: str
    read: Callable[[Mapping[str, Any]], AnyTrial]

    def outcomes(self, scenarios: Iterable[AnyTrial] | None = None) -> tuple[TrialOutcome[AnyTrial], ...]:
        """The kept outcomes, for these scenarios or all, each scenario once: its last result.

        Raises
        ------
        RigctlError
            the file cannot be read.
        """
        wanted = None if scenarios is None else {scenario.name for scenario in scenarios}
        outcomes = {}
        for line in self.lines():
            if line.get("version") == self.version and (wanted is None or line["scenario"] in wanted):
                outcomes[line["scenario"]] = TrialOutcome.read(line["outcome"], self.read)
        return tuple(outcomes.values())

    def missing(self, scenarios: Iterable[AnyTrial]) -> tuple[AnyTrial, ...]:
        """The scenarios without a result."""
        done = {line["scenario"] for line in self.lines() if line.get("version") == self.version}
        return tuple(scenario for scenario in scenarios if scenario.name not in done)

    def keep(self, outcome: TrialOutcome[AnyTrial]) -> None:
        """Append a result.

        Raises
        ------
        RigctlError
            the disk is full or missing.
        """
        line = {"scenario": outcome.scenario.name, "version": self.version, "outcome": outcome.document()}
        text = json.dumps(line, ensure_ascii=False, default=_plain)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("ab") as file:
                if self._cut_short():
                    file.write(b"\n")
                file.write(text.encode("utf-8") + b"\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as problem:
            raise RigctlError(
                f"cannot keep the result: {problem.strerror}", where=Location(self.path)
            ) from problem

    def _cut_short(self) -> bool:
        """True if the last line is truncated."""
        with self.path.open("rb") as file:
            if file.seek(0, os.SEEK_END) == 0:
                return False
            file.seek(-1, os.SEEK_END)
            return file.read(1) != b"\n"

    def lines(self) -> Iterator[dict[str, Any]]:
        """All kept results, of every version, as plain data.

        Raises
        ------
        RigctlError
            the file cannot be read.
        """
        try:
            text = self.path.read_text(encoding="utf-8", errors="replace")
        except FileNotFoundError:
            return
        except OSError as problem:
            raise RigctlError(
                f"cannot read the results: {problem.strerror}", where=Location(self.path)
            ) from problem
        for line in text.split("\n"):
            try:
                entry = json.loads(line)
            except ValueError:
                continue
            if isinstance(entry, dict) and {"scenario", "outcome"} <= entry.keys():
                yield entry


def every_outcome(
    path: Path, read: Callable[[Mapping[str, Any]], AnyTrial]
) -> tuple[TrialOutcome[AnyTrial], ...]:
    """Every result of a file, of all versions.

    Raises
    ------
    RigctlError
        the file cannot be read.
    """
    lines = ResultStore(path, "", read).lines()
    return tuple(TrialOutcome.read(line["outcome"], read) for line in lines)


def _plain(value: Any) -> Any:
    """NumPy's numbers as Python's."""
    return value.item() if hasattr(value, "item") else str(value)
