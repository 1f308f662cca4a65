"""A model on its runs, opened once and controlled by sliders and switches.

The equations are compiled once with every effect of the library, each at its null value until it is switched
on: a switch needs no compilation. While a slider moves, the record-level parameters (switch times, initial
values, sensor offsets) are kept; at rest they are fitted again, with the equations of the model alone, and
the numbers are those of ``rigctl compare --no-fit``.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.fitting import Data, OnProgress, fit_problem, no_progress, read_runs
from rigctl.analysis.search.model_change import Changed, Wanted, change_model
from rigctl.command_line import DataOptions
from rigctl.dataset.run import Run
from rigctl.effects.declaration import qualified
from rigctl.engine.least_squares import Iteration
from rigctl.engine.result_cache import switched_off
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem, make_problem
from rigctl.model.fit.unknowns import start_values
from rigctl.model.load import load_model
from rigctl.model.model import Model
from rigctl.model.plant import initial_state
from rigctl.model.setting import require_possible, set_by_hand, words_of
from rigctl.workbench.commands import Changes, Subject, set_command
from rigctl.workbench.controls import Slider, Switch, sliders, switches
from rigctl.workbench.picture import Picture, coarse_picture, exact_picture
from rigctl.workbench.state import State, Track

Floats = NDArray[np.float64]

#: longest time of a picture while a slider moves, s
_BUDGET = 0.04
#: fewest records in a picture while a slider moves
_FEWEST = 3


class Cancelled(Exception):
    """The result being computed is no longer wanted."""


@dataclass(frozen=True)
class Opened:
    """The constant part of a session.

    Attributes
    ----------
    model: as in its file.
    runs: that were opened.
    data: their records and noise.
    subject: runs, model and choice of records as typed on the command line.
    """

    model: Model
    runs: tuple[Run, ...]
    data: Data
    subject: Subject


class Workbench:
    """Runs and a model, the state of its sliders and switches, and the resulting pictures.

    Several threads may request pictures: each is of the given state, with the record-level parameters of the
    last `settle`.
    """

    def __init__(self, opened: Opened, on_progress: OnProgress = no_progress) -> None:
        self.opened = opened
        self.sliders: tuple[Slider, ...] = sliders(opened.model)
        self.switches: tuple[Switch, ...] = switches(opened.model)
        self.start = self._state_of_model()
        self.track = Track(self.start)
        self._cost: dict[str, float] = {}
        on_progress(f"Simulating {opened.model.name}")
        self._settled = self._fitted(self.start, on_progress)
        self.exact = exact_picture(self._settled)
        on_progress("Compiling the effects of the library")
        self._library = self._problem(opened.model, library=True, on_progress=on_progress)

    @classmethod
    def open(
        cls,
        runs: Sequence[Run],
        model_path: Path,
        choice: DataOptions | None = None,
        *,
        on_progress: OnProgress = no_progress,
        named: str = "",
    ) -> Workbench:
        """Read the records of `runs` and the model, and simulate it without a fit.

        Parameters
        ----------
        named: the model file as typed; by default its path.

        Raises
        ------
        RigctlError
            the runs are not of the model's bench, they are a table of single values, or the model cannot be
            simulated.
        """
        chosen = choice or DataOptions()
        model = load_model(model_path)
        data = read_runs(model, runs, hold_out=chosen.hold_out, only=chosen.only, on_progress=on_progress)
        subject = Subject(tuple(run.id for run in runs), named or model_path.as_posix(), chosen)
        return cls(Opened(model, tuple(runs), data, subject), on_progress)

    @property
    def model(self) -> Model:
        """The model as in its file."""
        return self.opened.model

    @property
    def problem(self) -> Problem:
        """The data with their noise, as in the last exact picture."""
        return self._settled.problem

    @property
    def fitted(self) -> FitResult:
        """The model at the last `settle`, with the record-level parameters fitted."""
        return self._settled

    def _state_of_model(self) -> State:
        every = [*self.sliders, *(one for switch in self.switches for one in switch.sliders)]
        on = frozenset(switch.name for switch in self.switches if switch.on)
        return State({slider.name: slider.value for slider in every}, on)

    def changes(self, state: State) -> Changes:
        """The difference between the state and the model in the file."""
        # Differences are counted against the model in the file, not against the last step: they become the
        # arguments of one command. A parameter that an effect's removal (or its base physics) sets anyway is
        # not a change of its own.
        added = tuple(s.name for s in self.switches if s.name in state.on and not s.on)
        removed = tuple(s.name for s in self.switches if s.name not in state.on and s.on)
        base = {p for s in self.switches if s.base and s.name not in state.on for p in _base(s, self.model)}
        values = tuple(
            name
            for name, value in state.values.items()
            if name in self.model.values
            and value != self.model.values[name]
            and name not in base
            and name.partition(".")[0] not in removed
        )
        return Changes(values, added, removed)

    def model_of(self, state: State) -> Model:
        """The model of the state, as it would be saved.

        Raises
        ------
        RigctlError
            effects that contradict one another are on, or a value is out of its bounds.
        """
        model, changes = self.model, self.changes(state)
        for name in changes.removed:
            model = model.without_effect(name)
        for name in changes.added:
            effect = model.effect(name)
            parameters = {one.name: state.values[qualified(name, one.name)] for one in effect.parameters}
            for key, value in parameters.items():
                require_possible(model, qualified(name, key), value)
            model = model.with_effect(name, parameters)
        for name in changes.values:
            require_possible(model, name, state.values[name])
        return set_by_hand(model, {name: state.values[name] for name in changes.values})

    def command(self, state: State) -> str:
        """The command that makes the state the model's next version; "" where it is the model already."""
        return set_command(self.opened.subject, self.model, state, self.changes(state))

    def settle(self, state: State, *, wanted: Callable[[], bool] = lambda: True) -> Picture:
        """The exact picture of a state; keeps the record-level parameters for the next pictures.

        Parameters
        ----------
        wanted: called in each iteration; `Cancelled` is raised if it returns False.

        Raises
        ------
        RigctlError
            effects that contradict one another are on, or the model cannot be simulated.
        """
        start = time.monotonic()
        self._settled = self._fitted(state, wanted=wanted)
        self.exact = exact_picture(self._settled, time.monotonic() - start)
        return self.exact

    def step(self, state: State) -> None:
        """Make a state the present one, to which `undo` returns.

        Raises
        ------
        RigctlError
            effects that contradict one another are on.
        """
        self.model_of(state)
        self.track = self.track.then(state)

    def retrace(self, present: State, past: Sequence[State], future: Sequence[State]) -> None:
        """Restore the steps of an earlier workbench on the same model and runs.

        Raises
        ------
        RigctlError
            effects that contradict one another are on.
        """
        for state in (*past, present, *future):
            self.model_of(state)
        before = tuple(past) or (() if present == self.start else (self.start,))
        self.track = Track(present, before, tuple(future))

    def undo(self) -> State:
        """Return to the previous state; see `Track.undone`."""
        self.track = self.track.undone()
        return self.track.present

    def redo(self) -> State:
        """Revert an `undo`; see `Track.redone`."""
        self.track = self.track.redone()
        return self.track.present

    def reopened(self, *, on_progress: OnProgress = no_progress) -> Workbench:
        """A workbench on the same records with the model's current file.

        Raises
        ------
        RigctlError
            the file is gone or wrong, or the model cannot be simulated.
        """
        path = self.model.path
        assert path is not None  # noqa: S101 - it was read from there
        return Workbench(replace(self.opened, model=load_model(path)), on_progress)

    def follow(self, state: State, shown: Sequence[int] = (), *, budget: float = _BUDGET) -> Picture:
        """A picture while a slider moves: of the records shown, and as many others as the time allows.

        Parameters
        ----------
        shown: indices of records that are always simulated.
        budget: s for it; infinite for all records.
        """
        start = time.monotonic()
        # Read once: `settle` may replace it in another thread while this picture is computed.
        settled = self._settled
        problem = self._equations_for(state, settled)
        chosen = self._coarse(problem, shown, budget)
        inner = self._moved(problem.only(chosen), state)
        simulated = inner.simulate(settled.values, [settled.local[k] for k in chosen])
        failures, outputs = {}, {}
        for at, k in enumerate(chosen):
            outputs[k] = np.full((inner.records[at].times.size, inner.channels.size), np.nan)
            measured = np.take(simulated.outputs[at], inner.channels, axis=1)
            outputs[k][: len(measured)] = measured
            failure = simulated.failures[at]
            if failure is not None:
                failures[k] = str(failure)
        took = time.monotonic() - start
        self._learn_cost(problem, took / max(1, len(chosen)))
        return coarse_picture(settled.problem, outputs, failures, settled.fitted, took)

    def _equations_for(self, state: State, settled: FitResult) -> Problem:
        """The settled model's equations if they contain every effect that is on, since they are faster."""
        on = {switch.name for switch in self.switches if not switch.base} & state.on
        if on <= set(settled.problem.model.effects):
            return settled.problem
        return self._library.with_shared(settled.problem.shared)

    def keep(self, state: State, *, on_progress: OnProgress = no_progress) -> Changed:
        """Make the state the model's next version, as `command` would.

        Raises
        ------
        RigctlError
            it is the model already, or the version cannot be saved.
        """
        changes = self.changes(state)
        if not changes:
            raise RigctlError("nothing differs from the model in its file")
        model, choice = self.model_of(state), self.opened.subject.choice
        path = self.model.path
        if path is None:
            raise RigctlError("this model was not read from a file, so there is no file to change")
        wanted = Wanted(
            "set",
            lambda _: model,
            False,
            choice.hold_out,
            choice.only,
            choice.assume,
            note=words_of(model, changes.values, changes.added, changes.removed),
        )
        return change_model(path, wanted, self.opened.runs, on_progress=on_progress)

    def _problem(self, model: Model, *, library: bool, on_progress: OnProgress) -> Problem:
        data = self.opened.data
        return make_problem(
            model,
            data.measurements,
            data.noise.model,
            data.noise.ok,
            library=library,
            grown=data.noise.grown,
            progress=on_progress,
        )

    def _fitted(
        self,
        state: State,
        on_progress: OnProgress = no_progress,
        wanted: Callable[[], bool] = lambda: True,
    ) -> FitResult:
        def iterated(_: Iteration) -> None:
            if not wanted():
                raise Cancelled

        problem = self._problem(self.model_of(state), library=False, on_progress=on_progress)
        data = self.opened.data
        with _not_kept():
            return fit_problem(problem, data.noise, data.held_out, refit=False, iterated=iterated)

    def _moved(self, problem: Problem, state: State) -> Problem:
        """The problem with the values of a state; equations and data are unchanged."""
        # The compiled equations stay as they are; a state is only another vector of base parameters, and
        # other initial states where these follow from parameters.
        values, system = self._values(state), problem.compiled.system
        base = problem.base.copy()
        for index, name in enumerate(system.parameter_names):
            base[index] = values.get(name, base[index])
        known = set(system.state_names)
        used = [self.model.effect(switch.name) for switch in self.switches if not switch.base]
        usual = {
            name: value for name, value in initial_state(self.model.family, used).items() if name in known
        }
        starts = [
            start_values(problem.level, record, problem.measurements, usual, values)
            for record in problem.records
        ]
        state_values = tuple(np.array([one[name] for name in system.state_names]) for one in starts)
        return replace(problem, base=base, starts=state_values)

    def _values(self, state: State) -> Mapping[str, float]:
        """The value of every parameter of the equations; effects that are off are at their null."""
        values = dict(state.values)
        for name, value in self.model.values.items():  # dimensions have no slider
            values.setdefault(name, value)
        for switch in self.switches:
            if switch.name not in state.on:
                effect = self.model.effect(switch.name)
                values |= dict(effect.base) or {
                    qualified(effect.name, key): value for key, value in effect.null.items()
                }
        return values

    def _coarse(self, problem: Problem, shown: Sequence[int], budget: float) -> list[int]:
        """Indices of records: those shown, then others spread over all, as many as the time allows."""
        count = len(problem.records)
        cost = self._cost.get(problem.compiled.source.digest, 0.0)
        # How many simulations fit into the budget, from the measured time of earlier ones with the same
        # equations; before the first, the least number.
        room = budget / cost if cost else (_FEWEST if math.isfinite(budget) else math.inf)
        wanted = int(min(count, max(_FEWEST, len(shown), room)))
        spread = [int(k) for k in np.linspace(0, count - 1, wanted).round()]
        return sorted(dict.fromkeys([*(k for k in shown if 0 <= k < count), *spread]))

    def _learn_cost(self, problem: Problem, each: float) -> None:
        """Update the simulation time per record with these equations, s: mean of new and previous value."""
        name = problem.compiled.source.digest
        self._cost[name] = 0.5 * (self._cost.get(name, each) + each)


def _base(switch: Switch, model: Model) -> tuple[str, ...]:
    """The family's parameters that switch off a part of the base physics."""
    return tuple(model.effect(switch.name).base)


@contextmanager
def _not_kept() -> Iterator[None]:
    """Do not store results: other commands will not need those of every slider position."""
    with switched_off():
        yield
