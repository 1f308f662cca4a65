"""The predicted power of a set of records, over draws of what may be right.

In: the rivals, what the data so far say of them (`Known`), and proposed records. Out: a `PredictedResult`:
for every pair the probability that a diagnosis of old and new records distinguishes it. It is an assurance:
the power averaged over draws of the right one's parameters from their posterior, because a power at the best
estimate alone would be too certain. The search itself does without draws, which would be needed for each of
hundreds of candidates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rigctl.design.criterion import Discrimination, Pair
from rigctl.design.feasible import clear_of_limits
from rigctl.design.information import Evidence, Refit
from rigctl.design.information_so_far import Known
from rigctl.design.power import Gain, gain
from rigctl.design.refitted_gain import refitted_gains
from rigctl.design.result import NONE, PredictedPower
from rigctl.design.rivals import Rival
from rigctl.design.search import Proposal, Workshop, together
from rigctl.design.virtual_records import Outlines
from rigctl.rig.rig import Rig
from rigctl.tasks import Workers

Floats = NDArray[np.float64]

#: number of draws of each rival's parameters
DRAWS = 100
#: rivals at a larger distance than this are distinguished whatever one of them refits
_FAR = 400.0
#: a smaller share of a gain than this counts as none
_NOTHING = 1e-9
#: no draws are made from a less probable rival than this, as its weight as a truth is negligible
_COUNTS = 1e-3


def drawn(rival: Rival, covariance: Floats, seed: int, count: int = DRAWS) -> Floats:
    """(draws, p) common unknowns, SI, from their posterior, kept inside their bounds.

    `covariance` is that of the unknowns over their typical sizes, for the stated noise; it is widened by the
    rival's overdispersion.
    """
    # θ = θ̂ + L·n, L·Lᵀ the posterior covariance. Draws are clipped at the bounds: a model may not be
    # simulated beyond them.
    rng = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(covariance * rival.overdispersion)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    away = rng.standard_normal((count, values.size)) @ root.T * rival.sizes
    shared = rival.fit.problem.shared
    low, high = np.array([u.lower for u in shared]), np.array([u.upper for u in shared])
    return np.asarray(np.clip(rival.fit.values + away, low, high))


@dataclass
class Draws:
    """The predictions of proposals at draws of every rival; each is simulated once.

    Attributes
    ----------
    known: covariance of each rival's common unknowns.
    workshop: where the proposals were made.
    """

    known: Known
    workshop: Workshop
    seed: int
    count: int
    _outputs: dict[tuple[int, int], Floats] = field(default_factory=dict)
    _kept: list[Proposal] = field(default_factory=list)
    _cached: dict[int, _TruthDraws] = field(default_factory=dict)
    _of: tuple[int, ...] = ()

    @property
    def rivals(self) -> Sequence[Rival]:
        """The rivals from which draws are made."""
        return self.workshop.rivals

    def outputs(self, index: int, proposal: Proposal) -> Floats:
        """(draws, n, outputs) SI for one rival; NaN if a draw cannot be simulated."""
        # Draws are the larger part of a design's cost, and the same ones are needed for the limits, for every
        # pair and for every set that contains the record.
        key = (index, id(proposal))
        if key not in self._outputs:
            self._kept.append(proposal)  # so that its id stays unique
            self._outputs[key] = self._simulated(index, proposal)
        return self._outputs[key]

    def _simulated(self, index: int, proposal: Proposal) -> Floats:
        rival = self.rivals[index]
        outlines = Outlines(rival, [proposal.record])
        courses = outlines.at_draws(
            drawn(rival, self.known.covariances[index], self.seed + index, self.count)
        )
        outputs = np.full((self.count, *proposal.record.values.shape), np.nan)
        for k, failure in enumerate(courses.failures):
            if failure is None:
                outputs[k] = outlines.measured(courses.outputs[k])
        return outputs

    def keeps_clear(self, rig: Rig, proposal: Proposal) -> bool:
        """Whether every draw of every rival that counts keeps clear of every limit."""
        sigma, times = self.workshop.scene(proposal).sigma, proposal.record.times
        channels = self.rivals[0].fit.problem.measurements.outputs
        for index, rival in enumerate(self.rivals):
            if rival.weight < _COUNTS and rival.name != NONE:  # the model as it is always counts
                continue
            for outputs in self.outputs(index, proposal):
                if not np.isfinite(outputs).all():
                    return False
                if not clear_of_limits(rig, channels, times, outputs, sigma):
                    return False
        return True

    def gain(self, pair: Pair, chosen: Sequence[Proposal]) -> Gain:
        """The gain of records together, if the first of the pair is right."""
        # D = Δᵀ·S₂⁻¹·Δ − δᵀ·S₁⁻¹·δ: what the rival still misses after its refit, less what the right one
        # itself would miss at its present fit, since it has to be refitted too.
        truth, rival = pair
        right = self._truth_draws(truth, chosen)
        refit, fit = self._refit(rival, chosen)
        away = right.truths - fit[:, None]
        return gain(right.from_fit, right.left, away, refit.left(away)).scaled(
            self.rivals[truth].overdispersion
        )

    def reach(
        self, linear: Mapping[Pair, float], chosen: Sequence[Proposal], workers: Workers | None
    ) -> dict[Pair, float]:
        """The share of a linear problem's D that remains when the rival is actually refitted, at most 1.

        Computed only if the two are near enough for it to matter.
        """
        # The linear problem only knows how far the rival bends at its present fit. One that is far away need
        # not be refitted: even a fraction of its distance suffices.
        near = [pair for pair, distance in linear.items() if 0.0 < distance < _FAR]
        scenes = [self.workshop.scene(one) for one in chosen]
        gained = dict(zip(near, refitted_gains(self.rivals, near, scenes, workers), strict=True))
        return {
            pair: min(gained[pair] / (self.rivals[pair[0]].overdispersion * distance), 1.0)
            if pair in gained
            else 1.0
            for pair, distance in linear.items()
        }

    def _truth_draws(self, truth: int, chosen: Sequence[Proposal]) -> _TruthDraws:
        """The draws of a truth; cached for one set of records at a time, as they take much memory."""
        names = tuple(map(id, chosen))
        if names != self._of:
            self._of, self._cached = names, {}
        if truth not in self._cached:
            self._cached[truth] = self._compute_truth_draws(truth, chosen)
        return self._cached[truth]

    def _compute_truth_draws(self, truth: int, chosen: Sequence[Proposal]) -> _TruthDraws:
        refit, fit = self._refit(truth, chosen)
        # Draws that could not be simulated are left out of the mean; they have been counted against the
        # record where its distance from the limits was judged.
        drawn_rows = np.vstack(
            [self.workshop.scene(one).whitener(np.moveaxis(self.outputs(truth, one), 0, 2)) for one in chosen]
        )
        truths = drawn_rows[:, np.isfinite(drawn_rows).all(axis=0)]
        from_fit = truths - fit[:, None]
        return _TruthDraws(truths, from_fit, refit.left(from_fit))

    def _refit(self, index: int, chosen: Sequence[Proposal]) -> tuple[Refit, Floats]:
        """The refit of a rival to records, and its whitened prediction of them at its present fit."""
        responses = [
            scene.predicted[index].response(scene.whitener) for scene in map(self.workshop.scene, chosen)
        ]
        fit = np.concatenate([one.predicted for one in responses])
        return Refit.of(responses, self.known.information[index]), fit


@dataclass(frozen=True)
class _TruthDraws:
    """Draws of what may be right, whitened.

    Attributes
    ----------
    truths: (rows, draws) their predictions.
    from_fit: `truths` less the prediction of the rival itself at its fit.
    left: the part of `from_fit` that remains after the rival is refitted.
    """

    truths: Floats
    from_fit: Floats
    left: Floats


@dataclass(frozen=True)
class PredictedResult:
    """The predicted result of some records.

    Attributes
    ----------
    outlooks: for every pair.
    separation: Σ w_i·min_j D_ij, the mean over draws.
    probability: that the right one is distinguished from all its rivals.
    """

    outlooks: tuple[PredictedPower, ...]
    separation: float
    probability: float


def as_refitted(
    criterion: Discrimination, draws: Draws, chosen: Sequence[Proposal], workers: Workers | None = None
) -> Discrimination:
    """The criterion with the share of the linear D of these records that remains after actual refits."""
    if not chosen:
        return criterion
    linear = replace(criterion, reach={})
    distances = linear.distances(together(chosen))
    nearby = {pair: float(distances[pair]) for pair in criterion.pairs}
    return replace(criterion, reach=draws.reach(nearby, chosen, workers))


def predicted_result(criterion: Discrimination, draws: Draws, chosen: Sequence[Proposal]) -> PredictedResult:
    """The predicted result of records together; with no records, that of the data so far."""
    # Before any record the gain is 0 with certainty: the "before" of each pair is what the margin so far
    # decides.
    nothing = Gain(np.zeros(1), np.zeros(1))
    rivals = criterion.question.rivals
    evidence: Evidence | None = together(chosen) if chosen else None
    count = len(rivals)
    distances = np.zeros((count, count)) if evidence is None else criterion.distances(evidence)
    before = {pair: criterion.of_pair(pair, nothing, np.zeros((count, count))) for pair in criterion.pairs}
    # At the draws a rival is refitted linearly. Of that gain an actual refit leaves the share `stays`: it is
    # the gain in noise wider by its inverse.
    gains = {
        pair: draws.gain(pair, chosen).scaled(1.0 / max(criterion.stays(pair), _NOTHING))
        if chosen
        else nothing
        for pair in criterion.pairs
    }
    after = {pair: criterion.of_pair(pair, gains[pair], distances) for pair in criterion.pairs}
    outlooks = tuple(
        PredictedPower(
            truth=rivals[pair[0]].name,
            rival=rivals[pair[1]].name,
            margin=criterion.margins.margin(*pair),
            threshold=criterion.margins.threshold(pair[0], distances),
            separation=float(np.mean(gains[pair].mean)),
            spread=float(np.std(gains[pair].mean)),
            before=before[pair],
            after=after[pair],
        )
        for pair in criterion.pairs
    )
    means = {pair: float(np.mean(one.mean)) for pair, one in gains.items()}
    return PredictedResult(outlooks, criterion.together(means), criterion.together(after))
