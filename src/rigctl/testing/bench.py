"""A bench in virtual time: procedures carried out on a rig without hardware."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rigctl.backends.protocol import Backend
from rigctl.backends.registry import create_backend
from rigctl.clock import Clock, VirtualClock
from rigctl.dataset.recording.header import RunHeader, Source, calibrations_of, source_of_rig
from rigctl.dataset.recording.log import read_lines
from rigctl.dataset.recording.writer import RunWriter
from rigctl.dataset.run_id import new_run_id
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.plan import Plan
from rigctl.procedure import expand, load_procedure, parse_procedure
from rigctl.rig import Rig, load_rig, parse_rig
from rigctl.runner.operators.automatic_operator import AutomaticOperator
from rigctl.runner.session import run
from rigctl.testing.run_log import RunLog

#: start time of every run
_BEGAN = datetime(2000, 1, 1, tzinfo=UTC)


@dataclass
class VirtualBench:
    """Carries out procedures in virtual time, and keeps the runs in a folder of the test.

    Attributes
    ----------
    folder: for the runs.
    rig_file: of the bench; the shipped cylinder's when None.
    options: of every simulated bench; by default without noise and quantisation.
        ``{"plant": "roles"}`` is a quick bench without physics, in which each role has its nominal effect.
    """

    folder: Path
    rig_file: Path | None = None
    options: Mapping[str, object] = field(default_factory=lambda: {"noise": "off", "quantised": "off"})

    def rig(self, old: str = "", new: str = "") -> Rig:
        """The rig; with `old`, its file with one piece of its text replaced."""
        path = self.rig_file or shipped("rigs", "hl32-bench.yaml")
        if not old:
            return load_rig(path)
        text = path.read_text(encoding="utf-8")
        if old not in text:
            raise RigctlError("the rig file has no such text", value=old)
        return parse_rig(text.replace(old, new))

    def plan(self, steps: str | Path, rig: Rig | None = None, **arguments: str) -> Plan:
        """A plan of a procedure file, or of the text below ``procedure: test``."""
        if isinstance(steps, Path):
            return expand(load_procedure(steps), rig or self.rig(), arguments)
        return expand(parse_procedure(f"procedure: test\n{steps}"), rig or self.rig(), arguments)

    def backend(self, rig: Rig, clock: Clock | None = None, **options: object) -> Backend:
        """The simulated bench of a rig, opened; `options` are added to those of this object."""
        backend = create_backend(rig, "simulated", clock or VirtualClock(), {**self.options, **options})
        backend.open()
        return backend

    def header(self, plan: Plan, backend: Backend) -> RunHeader:
        """Header of the run."""
        procedure = Source(plan.name, plan.procedure.text, plan.procedure.sha256)
        return RunHeader(
            id=new_run_id(plan.name, _BEGAN, self.folder / "runs"),
            procedure=procedure,
            rig=source_of_rig(plan.rig),
            layout=plan.rig.layout,
            started=_BEGAN,
            backend=backend.identity,
            clock=backend.clock.name,
            plan_digest=plan.digest,
            calibrations=calibrations_of(plan.rig),
        )

    def run(
        self,
        steps: str | Path,
        *,
        rig: Rig | None = None,
        arguments: Mapping[str, str] | None = None,
        options: Mapping[str, object] | None = None,
        **more: Any,
    ) -> RunLog:
        """Carry out a procedure; requests are handled after every sample.

        Parameters
        ----------
        steps: a procedure file, or the text below ``procedure: test``.
        arguments: of the procedure, with units.
        options: of the simulated bench: ``{"faults": ("sensor_stuck:position@1 s",)}``.
        more: ``backend`` (opened) for another bench, ``writer``, arguments of `rigctl.runner.session.run`.
        """
        plan = self.plan(steps, rig, **dict(arguments or {}))
        backend: Backend | None = more.pop("backend", None)
        if backend is None:
            backend = self.backend(plan.rig, None, **(options or {}))
        writer = more.pop("writer", None) or RunWriter.create(
            self.folder / "runs", self.header(plan, backend)
        )
        more.setdefault("operator", AutomaticOperator())
        result = run(plan, backend, writer, response=0.0, **more)
        lines = read_lines(result.folder / "log.jsonl") if result.folder is not None else []
        return RunLog(result, [line for line in lines if line is not None], plan.rig)
