"""Runs to test with: the shipped rig on the plain plant, a procedure written in the test, virtual time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rigctl.backends.protocol import Backend
from rigctl.backends.registry import create_backend
from rigctl.clock import Clock, VirtualClock
from rigctl.dataset.header import RunHeader, Source, source_of_rig
from rigctl.dataset.log import read_lines
from rigctl.dataset.writer import RunWriter
from rigctl.plan import Plan
from rigctl.procedure.expand import expand
from rigctl.procedure.load import parse_procedure
from rigctl.rig import Rig, load_rig, parse_rig
from rigctl.runner.operator import AutomaticOperator
from rigctl.runner.requests import Order, Request
from rigctl.runner.session import RunResult, run
from rigctl.runner.view import View

RIG = Path(__file__).parents[1] / "rigs" / "hl32-bench.yaml"


@dataclass
class Done:
    """A run that is over, and what it logged."""

    result: RunResult
    log: list[dict[str, Any]]

    def events(self, kind: str) -> list[dict[str, Any]]:
        return [event for event in self.log if event["kind"] == kind]

    def messages(self, kind: str) -> list[str]:
        return [str(event.get("message", "")) for event in self.events(kind)]

    @property
    def states(self) -> list[str]:
        return [event["state"] for event in self.events("state")]

    def outcome(self, label: str) -> str:
        """How the last step whose label begins so ended."""
        paths = [
            e["path"] for e in self.events("step") if e["state"] == "begin" and e["message"].startswith(label)
        ]
        return str(next(e["outcome"] for e in reversed(self.events("step"))
                        if e["state"] == "end" and e["path"] == paths[-1]))  # fmt: skip

    def commands(self, actuator: str) -> list[tuple[float, float]]:
        """Time and value of every switch of an actuator."""
        return [(e["time"], e["value"]) for e in self.events("command") if e["actuator"] == actuator]

    @property
    def records(self) -> list[tuple[str, str]]:
        """Path and outcome of every record."""
        opened = {e["record"]: e["path"] for e in self.events("record") if e["state"] == "open"}
        return [(opened[e["record"]], e["outcome"]) for e in self.events("record") if e["state"] == "closed"]


@dataclass
class ScriptedControl:
    """Asks for something at a bench time, as a key or another terminal would."""

    orders: list[tuple[float, Request]] = field(default_factory=list)
    answers: list[str] = field(default_factory=list)
    views: list[View] = field(default_factory=list)
    time: float = 0.0

    def poll(self) -> list[Order]:
        due = [request for when, request in self.orders if self.time >= when]
        self.orders = [(when, request) for when, request in self.orders if self.time < when]
        return [Order(request, "a test") for request in due]

    def acknowledge(self, order: Order, message: str) -> None:
        self.answers.append(message)

    def publish(self, view: View) -> None:
        self.time = view.time
        self.views.append(view)

    def close(self) -> None: ...


@dataclass
class Workshop:
    """Makes rigs, plans, writers and runs, all in one folder."""

    folder: Path

    def rig(self, old: str = "", new: str = "") -> Rig:
        """The shipped rig with one piece of its text replaced."""
        if not old:
            return load_rig(RIG)
        text = RIG.read_text(encoding="utf-8")
        assert old in text
        return parse_rig(text.replace(old, new))

    def plan(self, steps: str, rig: Rig | None = None, **arguments: str) -> Plan:
        """A plan from the text below `procedure: test`."""
        return expand(parse_procedure(f"procedure: test\n{steps}"), rig or self.rig(), arguments)

    def backend(self, rig: Rig, clock: Clock | None = None, **options: object) -> Backend:
        chosen = {"plant": "roles", "noise": "off", "quantised": "off", **options}
        backend = create_backend(rig, "simulated", clock or VirtualClock(), chosen)
        backend.open()
        return backend

    def header(self, plan: Plan, backend: Backend) -> RunHeader:
        procedure = Source(plan.name, plan.procedure.text, plan.procedure.sha256)
        return RunHeader(
            id="20000101-000000-test",
            procedure=procedure,
            rig=source_of_rig(plan.rig),
            layout=plan.rig.layout,
            started=datetime(2000, 1, 1, tzinfo=UTC),
            backend=backend.identity,
            clock=backend.clock.name,
            plan_digest=plan.digest,
        )

    def run(
        self, steps: str, *, rig: Rig | None = None, options: Mapping[str, object] | None = None, **more: Any
    ) -> Done:
        """Carry out the steps in virtual time; requests are looked at after every sample."""
        plan = self.plan(steps, rig)
        backend = more.pop("backend", None) or self.backend(plan.rig, **(options or {}))
        writer = more.pop("writer", None) or RunWriter.create(
            self.folder / "runs", self.header(plan, backend)
        )
        more.setdefault("operator", AutomaticOperator())
        result = run(plan, backend, writer, response=0.0, **more)
        return Done(result, read_lines(result.folder / "log.jsonl"))
