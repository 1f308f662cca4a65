"""One entry of a survey evaluated with the survey's model: its information about every parameter and effect.

The freed parameters are fitted to the entry's records, starting where the reference ends; the others are held
at its values. The model is linearised at that point,

    r = W(y − f(θ̂)) ≈ Σ_j a_j δ_j,   G = AᵀA,   b = Aᵀr,

with a column a_j for each parameter that the model's file frees, including held ones, and for each effect
that the model may lack; record-level unknowns are projected off. Only G and b are kept of an entry: they give
the size of any effect with any others freed, without access to the data.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.agreement.adequacy import adequacy
from rigctl.analysis.comparison import data_notes
from rigctl.analysis.fitting import Data, fit_problem, read_runs
from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.linear.linearisation import Linearisation, linearise
from rigctl.analysis.linear.nuisance_projection import HIDDEN, least_share, project
from rigctl.analysis.linear.score_test import screen
from rigctl.dataset import open_run
from rigctl.engine.one_thread import one_thread
from rigctl.engine.result_cache import cached, switched_off
from rigctl.errors import RigctlError
from rigctl.model.fit.fit import FitResult
from rigctl.model.fit.problem import Problem, make_problem
from rigctl.model.fit.unknowns import parameter_unknown
from rigctl.model.measured.assumed import assuming
from rigctl.model.measured.note import Note
from rigctl.model.model import Model
from rigctl.monitoring.entries import Entry

Floats = NDArray[np.float64]


#: fits end when the next step would lower the cost by less than this share; the linear problem at their end
#: then makes up for that step
_COST = 1e-3


@dataclass(frozen=True)
class Plan:
    """The settings with which every entry is evaluated; sent to each worker once.

    Attributes
    ----------
    model: its values are the starts of the fits, and the values of the held parameters.
    freed, held: of the parameters that its file frees, those fitted in each entry, and the others.
    candidates: the effects that it may lack, each at one shape, the same for all entries.
    only: a condition that selects records; `assume` values of inputs that were not recorded.
    """

    model: Model
    freed: tuple[str, ...]
    held: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    only: str | None = None
    assume: tuple[str, ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of A's columns: freed, held, and those of the candidates."""
        return (*self.freed, *self.held, *(name for one in self.candidates for name in one.columns))


@dataclass(frozen=True)
class Reading:
    """The information in one entry.

    Attributes
    ----------
    values: of the freed parameters, SI, as fitted.
    at_bound: those that the fit left at a bound.
    gram, score: (columns, columns) G and (columns) b.
    lengths: (columns) lengths of the whitened columns before any projection.
    p_value: of the tests of adequacy together; `adequate` whether none rejects.
    chi2_reduced: squared misfit per degree of freedom.
    records, samples: their numbers.
    notes: remarks on its data, as `rigctl compare` has them.
    least: what has to be left of a column beside the others, as a share of its length.
    """

    values: Floats
    at_bound: tuple[str, ...]
    gram: Floats = field(repr=False)
    score: Floats = field(repr=False)
    lengths: Floats = field(repr=False)
    p_value: float = 1.0
    adequate: bool = True
    chi2_reduced: float = 1.0
    records: int = 0
    samples: int = 0
    notes: tuple[Note, ...] = ()
    least: float = HIDDEN


@dataclass(frozen=True)
class Failure:
    """An entry that could not be read, and why, in words."""

    reason: str


@one_thread()
def read_entry(plan: Plan, entry: Entry) -> Reading | Failure:
    """Evaluate one entry; an error in it does not end the survey."""
    try:
        return _read(plan, entry)
    except RigctlError as problem:
        return Failure(str(problem).splitlines()[0])
    except (ArithmeticError, np.linalg.LinAlgError) as problem:
        return Failure(f"the fit failed: {problem}")


def _read(plan: Plan, entry: Entry) -> Reading:
    problem, data = problem_of(plan, entry)
    rebuilt = problem.rebuilt(problem.model, library=bool(plan.candidates))
    tried = [(one.columns, one.shapes, one.secants) for one in plan.candidates]
    base = [plan.model.values[name] for name in plan.held]
    content = (rebuilt.content, plan.freed, plan.held, base, tried)
    return cached("survey", content, Reading, lambda: _reading_of(plan, problem, data))


def problem_of(plan: Plan, entry: Entry) -> tuple[Problem, Data]:
    """The entry's records and the freed parameters of the model as a least-squares problem.

    Raises
    ------
    RigctlError
        as `rigctl.analysis.fitting.read_runs`, and if a record of the entry no longer exists.
    """
    data = measured(plan, entry.runs)
    if entry.records is not None:
        wanted = set(entry.records)
        records = data.measurements.records
        indices = [k for k, record in enumerate(records) if (record.run, record.index) in wanted]
        if not indices:
            raise RigctlError("none of its records can be used")
        data = Data(data.measurements.only(indices), data.noise.only(indices), ())
    model = freeing(plan.model, plan.freed)
    return make_problem(
        model, data.measurements, data.noise.model, data.noise.ok, grown=data.noise.grown
    ), data


#: the last runs read in this process, with the plan: many entries may be records of one run
_LAST: list[tuple[tuple[Any, ...], Data]] = []


def measured(plan: Plan, refs: tuple[str, ...]) -> Data:
    """The records of the runs, read once for all entries that are records of them."""
    key = (plan.model.family, plan.model.rig, plan.only, plan.assume, refs)
    for known, data in _LAST:
        if known == key:
            return data
    runs = [assuming(open_run(ref), plan.model, plan.assume) for ref in refs]
    data = read_runs(plan.model, runs, only=plan.only)
    _LAST[:] = [(key, data)]
    return data


def freeing(model: Model, names: Sequence[str]) -> Model:
    """The model with these parameters, and no others, free."""
    chosen = set(names)

    def marked(values: Mapping, before: str = "") -> MappingProxyType:  # type: ignore[type-arg]
        return MappingProxyType(
            {name: replace(value, fit=before + name in chosen) for name, value in values.items()}
        )

    return replace(
        model,
        parameters=marked(model.parameters),
        effects=MappingProxyType(
            {effect: marked(values, f"{effect}.") for effect, values in model.effects.items()}
        ),
    )


def _reading_of(plan: Plan, problem: Problem, data: Data) -> Reading:
    with switched_off():  # only the reading is needed again
        # Every entry starts at the reference and not at its neighbour, so that entries may be evaluated in
        # any order and on any computer with the same result.
        local = [np.array([one.start for one in unknowns]) for unknowns in problem.local_unknowns()]
        fitted = fit_problem(problem, data.noise, local=local, cost=_COST)
        linear = _linearised(plan, fitted)
        # the tests project off what the fit could move, which excludes held parameters
        movable = [k for k, name in enumerate(linear.nuisances) if name not in plan.held]
        tested = project(_with_nuisances(linear, movable))
        judged = adequacy(tested, screen(tested))
    # The fit is only coarse: the linear problem at its end makes up for the last step (`solved`).
    gram, score, lengths = _normal_equations(plan, linear)
    measured = fitted.problem.measurements
    parameters = dict(zip((one.name for one in fitted.problem.shared), fitted.values, strict=True))
    return Reading(
        values=np.array([parameters.get(name, plan.model.values[name]) for name in plan.freed]),
        at_bound=tuple(sorted(fitted.at_bound & set(plan.freed))),
        gram=gram,
        score=score,
        lengths=lengths,
        p_value=judged.p_value,
        adequate=judged.adequate,
        chi2_reduced=fitted.chi2_reduced,
        records=len(measured.records),
        samples=measured.samples,
        notes=tuple(dict.fromkeys(data_notes(fitted))),
        least=least_share(fitted),
    )


def _linearised(plan: Plan, fitted: FitResult) -> Linearisation:
    """The linearisation at the fit, with the held parameters among the columns, without their priors."""
    held = [replace(parameter_unknown(plan.model, name), prior=None) for name in plan.held]
    values = np.concatenate([fitted.values, [one.start for one in held]])
    problem = fitted.problem.with_shared((*fitted.problem.shared, *held))
    free = [one for one in problem.shared if one.name not in fitted.at_bound]
    rebuilt = problem.rebuilt(problem.model, library=bool(plan.candidates))
    return linearise(replace(fitted, problem=problem, values=values), rebuilt, plan.candidates, free=free)


def _with_nuisances(linear: Linearisation, indices: Sequence[int]) -> Linearisation:
    """The linear problem with a selection of the nuisances."""
    chosen = list(indices)
    weight, residual = linear.prior
    return replace(
        linear,
        nuisances=tuple(linear.nuisances[k] for k in chosen),
        records=tuple(replace(one, nuisance=one.nuisance[:, chosen]) for one in linear.records),
        prior=(weight[np.ix_(chosen, chosen)], residual[chosen]),
    )


def _normal_equations(plan: Plan, linear: Linearisation) -> tuple[Floats, Floats, Floats]:
    """G, b and the columns' lengths, in the order of the plan; 0 for columns about which the entry has no
    data.

    Shared unknowns that are not parameters of the model, such as a logger's delay, are projected off.
    """
    names = [*linear.nuisances, *(name for one in linear.candidates for name in one.columns)]
    weight, prior = linear.prior
    rows = [np.hstack([one.nuisance, one.signatures]) for one in linear.records]
    below = np.zeros((weight.shape[0], len(names)))
    below[:, : weight.shape[1]] = weight
    columns = np.vstack([*rows, below])
    residual = np.concatenate([*(one.residual for one in linear.records), prior])
    known = {name: k for k, name in enumerate(names)}
    # Shared unknowns that are no quantities of the survey are projected off here, once and for all; of the
    # others G and b are kept, so that any of them may be freed or held later.
    others = [k for k, name in enumerate(linear.nuisances) if name not in plan.columns]
    shared = len(linear.nuisances)
    lengths = np.append(np.linalg.norm(columns[:, :shared], axis=0), linear.full_lengths)
    if others:
        basis = np.linalg.qr(columns[:, others])[0]
        columns = columns - basis @ (basis.T @ columns)
        residual = residual - basis @ (basis.T @ residual)
    count = len(plan.columns)
    gram, score, full = np.zeros((count, count)), np.zeros(count), np.zeros(count)
    present = [k for k, name in enumerate(plan.columns) if name in known]
    indices = [known[plan.columns[k]] for k in present]
    chosen = columns[:, indices]
    gram[np.ix_(present, present)] = chosen.T @ chosen
    score[present] = chosen.T @ residual
    full[present] = lengths[indices]
    return gram, score, full


def solved(reading: Reading, wanted: int, freed: Sequence[int]) -> tuple[float, float]:
    """The step of one column with others freed beside it, and its standard deviation; NaN if undetermined.

    Parameters
    ----------
    wanted, freed: indices of columns; `wanted` is freed too.
    """
    others = [k for k in freed if k != wanted and reading.gram[k, k] > 0.0]
    curvature, pull = float(reading.gram[wanted, wanted]), float(reading.score[wanted])
    if curvature <= 0.0:
        return math.nan, math.nan
    if others:
        # Schur complement: with the others o eliminated, a = (b_w − G_wo·G_oo⁻¹·b_o)/(G_ww −
        # G_wo·G_oo⁻¹·G_ow). Columns are scaled to unit length first, as units differ by many powers of ten.
        block = reading.gram[np.ix_(others, others)]
        scale = 1.0 / np.sqrt(np.diag(block))
        inverse = np.linalg.pinv(block * np.outer(scale, scale), rcond=1e-10, hermitian=True)
        cross = reading.gram[others, wanted] * scale
        curvature -= float(cross @ inverse @ cross)
        pull -= float(cross @ inverse @ (reading.score[others] * scale))
    if curvature <= (reading.least * float(reading.lengths[wanted])) ** 2:
        return math.nan, math.nan
    return pull / curvature, 1.0 / math.sqrt(curvature)
