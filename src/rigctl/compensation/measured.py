"""The quantity to be kept: a measure that the procedure of the runs computes in every record.

In: runs, their rig, and a target such as ``stroke = 110 mm``. Out: a `TakenMeasure`, which computes the same
number from samples that a model predicts. The definition is that of the procedure with which the runs were
made, so that what is predicted is what was measured.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.dataset.run import Run
from rigctl.errors import RigctlError, unknown_name
from rigctl.json_values import parse_json
from rigctl.plan import Group, Leaf, Node, Plan
from rigctl.plan.statistics import DURATION, Stretch
from rigctl.plan.tree import GroupKind, RecordNode, children
from rigctl.procedure import expand, load_procedure
from rigctl.rig import Rig
from rigctl.steps.measure import Measure
from rigctl.units import parse_quantity

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Target:
    """The target: the name of a measure, its value, SI, and the unit in which it was written."""

    name: str
    value: float
    unit: str

    @staticmethod
    def read(text: str) -> Target:
        """``stroke = 110 mm``.

        Raises
        ------
        RigctlError
            the text has another form.
        """
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise RigctlError(
                "not a target", value=text, expected='a measure and its value, "stroke = 110 mm"'
            )
        try:
            quantity = parse_quantity(value)
        except RigctlError as error:
            raise RigctlError(
                "not a target", value=text, expected=f"a value with its unit: {error}"
            ) from error
        return Target(name, quantity.si, quantity.unit.text)


@dataclass(frozen=True)
class TakenMeasure:
    """A measure as computed by the procedure.

    Attributes
    ----------
    at: s from a record's first sample.
    file: the procedure that makes one record, and the `arguments` with which it was called in each, as
        written: by run and index of the record.
    """

    measure: Measure
    at: float
    file: Path
    arguments: Mapping[tuple[str, int], Mapping[str, str]]

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels from which it is computed."""
        return tuple(dict.fromkeys(one.channel for one in self.measure.statistics))

    def of(self, times: Floats, values: Mapping[str, Floats], switches: Floats) -> float:
        """The measure's value from the samples of a record, SI; commands change at the times `switches`."""
        first = 0.0
        if self.measure.stretch is Stretch.WINDOW:
            first = self.at - (self.measure.window or 0.0)
        elif self.measure.stretch is Stretch.PHASE:
            first = max((float(one) for one in switches if one <= self.at), default=0.0)
        inside = (times >= first - 1e-9) & (times <= self.at + 1e-9)
        known = {
            one.key: one.compute(values[one.channel][inside].tolist()) for one in self.measure.statistics
        }
        return float(self.measure.expression.evaluate({**known, DURATION: self.at - first}))


def require_measure(runs: Sequence[Run], name: str) -> None:
    """Check that each run took a measure of that name.

    Raises
    ------
    RigctlError
        a run took none, or none of that name.
    """
    for run in runs:
        named = sorted({str(one) for one in run.info["measures"]} | _measures_of_records(run))
        if not named:
            raise RigctlError(
                f"the run {run.id} took no measure",
                value=name,
                expected="a run of a procedure whose records have a 'measure' step",
            )
        if name not in named:
            raise unknown_name(f"measure of the run {run.id}", name, named)


def find_measure(runs: Sequence[Run], rig: Rig, target: Target) -> TakenMeasure:
    """The measure with that name, from the procedure by which the runs were made.

    Raises
    ------
    RigctlError
        no record takes the measure, or their procedure no longer exists or has changed.
    """
    arguments: dict[tuple[str, int], Mapping[str, str]] = {}
    measures: list[tuple[Measure, Path]] = []
    for run in runs:
        plan = _plan_of(run, rig)
        nodes = {node.path: (node, call) for node, call in _records(plan.root, None)}
        for _, row in run.records.iterrows():
            node, call = nodes.get(str(row["path"]), (None, None))
            measure = None if node is None else _measure_in(node, target.name)
            if node is None or measure is None or node.where.file is None:
                continue
            measures.append((measure, Path(node.where.file)))
            values = call.bindings if call is not None else plan.arguments
            arguments[run.id, int(row["record"])] = dict(values)
    if not measures:
        raise RigctlError(f"no record of these runs takes the measure '{target.name}' in itself")
    measure, file = measures[0]
    return TakenMeasure(measure, _when(runs, target.name), file, arguments)


def _measures_of_records(run: Run) -> set[str]:
    events = run.events
    measured = events[events["kind"] == "measure"]
    with run.event_data():
        return {str(parse_json(data)["name"]) for data in measured["data"]}


def _when(runs: Sequence[Run], name: str) -> float:
    """Time after a record's start at which it is computed, s, the median of all."""
    times = []
    for run in runs:
        begins = dict(zip(run.records["record"], run.records["start"], strict=True))
        events = run.events
        measured = events[(events["kind"] == "measure") & (events["record"] >= 0)]
        with run.event_data():
            for time, record, data in zip(
                measured["time"], measured["record"], measured["data"], strict=True
            ):
                if parse_json(data)["name"] == name and record in begins:
                    times.append(float(time) - float(begins[record]))
    return float(np.median(times))


def _plan_of(run: Run, rig: Rig) -> Plan:
    path = run.header.procedure.path
    if not path or not Path(path).is_file():
        raise RigctlError(
            f"the procedure of the run {run.id} is needed, and is not there",
            value=path or "none",
            expected="the file that the run was made with: it says how the measure is taken",
        )
    plan = expand(load_procedure(Path(path)), rig, dict(run.header.arguments))
    if run.header.plan_digest and plan.digest != run.header.plan_digest:
        raise RigctlError(
            f"the procedure has changed since the run {run.id}: it no longer says how that was measured",
            value=path,
        )
    return plan


def _records(node: Node, call: Group | None) -> Iterator[tuple[RecordNode, Group | None]]:
    """Every record with the innermost call that contains it."""
    if isinstance(node, RecordNode):
        yield node, call
        return
    inner = node if isinstance(node, Group) and node.kind is GroupKind.CALL else call
    for child in children(node):
        yield from _records(child, inner)


def _measure_in(node: Node, name: str) -> Measure | None:
    if isinstance(node, Leaf) and isinstance(node.action, Measure) and node.action.name == name:
        return node.action
    measures = (_measure_in(child, name) for child in children(node))
    return next((one for one in measures if one is not None), None)
