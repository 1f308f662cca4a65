"""A finished run with its log, in a form convenient for assertions."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from rigctl.notebook import one_line
from rigctl.rig import Rig
from rigctl.runner.session import RunResult


@dataclass
class RunLog:
    """How a run ended, and every event of its log in order.

    Attributes
    ----------
    result: status, reason, exit code, folder.
    log: one mapping for each event, as in ``log.jsonl``.
    rig: on which it was carried out.
    """

    result: RunResult
    log: list[dict[str, Any]] = field(repr=False)
    rig: Rig

    def __repr__(self) -> str:
        """One-line representation."""
        return one_line(self, self.result.summary())

    def events(self, kind: str) -> list[dict[str, Any]]:
        """The events of one kind: ``step``, ``command``, ``record``, ``note``, …"""
        return [event for event in self.log if event["kind"] == kind]

    def messages(self, kind: str) -> list[str]:
        """Texts of the events of one kind."""
        return [str(event.get("message", "")) for event in self.events(kind)]

    @property
    def states(self) -> list[str]:
        """The states that the run went through."""
        return [event["state"] for event in self.events("state")]

    def outcome(self, label: str) -> str:
        """Outcome of the last step whose label begins with `label`.

        Raises
        ------
        LookupError
            no step with this label was carried out.
        """
        steps = self.events("step")
        paths = [e["path"] for e in steps if e["state"] == "begin" and e["message"].startswith(label)]
        ends = [e["outcome"] for e in steps if paths and e["state"] == "end" and e["path"] == paths[-1]]
        if not ends:
            raise LookupError(f"no step whose label begins with {label!r} was carried out")
        return str(ends[-1])

    def commands(self, actuator: str) -> list[tuple[float, float]]:
        """Time (s) and value (SI) of every switch of an actuator."""
        return [(e["time"], e["value"]) for e in self.events("command") if e["actuator"] == actuator]

    @property
    def records(self) -> list[tuple[str, str]]:
        """Path and outcome of every record."""
        opened = {e["record"]: e["path"] for e in self.events("record") if e["state"] == "open"}
        return [(opened[e["record"]], e["outcome"]) for e in self.events("record") if e["state"] == "closed"]
