"""The evidence of a component of variance against the same likelihood written with covariance matrices."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigctl.analysis.linear import marginal_likelihood as module
from rigctl.analysis.linear.marginal_likelihood import Component, Normal, evidence

Floats = NDArray[np.float64]


class Case:
    """Records with columns B, unknowns J and a residual r; B is scaled as `Component` requires."""

    def __init__(self, seed: int, size: float = 0.0, features: int = 2) -> None:
        rng = np.random.default_rng(seed)
        self.records, self.rows, self.k = 5, 12, 3
        self.b = rng.standard_normal((self.records, self.rows, self.k))
        self.b /= np.sqrt(np.square(self.b).sum())
        self.j = rng.standard_normal((self.records, self.rows, 2))
        self.phi = np.column_stack([np.ones(self.records), np.linspace(-1.0, 1.0, self.records)])[
            :, :features
        ]
        self.truth = size * np.outer(np.ones(self.records), [1.0, -1.0, 0.5])
        noise = rng.standard_normal((self.records, self.rows))
        self.r = noise + np.einsum("cnk,ck->cn", self.b, self.truth)

    @property
    def normal(self) -> Normal:
        flat, r = self.j.reshape(-1, 2), self.r.ravel()
        return Normal(flat.T @ flat, flat.T @ r, float(r @ r))

    @property
    def component(self) -> Component:
        back = np.swapaxes(self.b, 1, 2)
        return Component(back @ self.b, back @ self.j, np.einsum("cnk,cn->ck", self.b, self.r))

    def likelihood(self, u: float, v: float) -> float:
        """The log-likelihood of r with θ integrated out."""
        rows = self.records * self.rows
        covariance = np.eye(rows)
        for c in range(self.records):
            for d in range(self.records):
                strength = v * float(self.phi[c] @ self.phi[d]) + u * (c == d)
                block = np.s_[c * self.rows : (c + 1) * self.rows, d * self.rows : (d + 1) * self.rows]
                covariance[block] += strength * self.b[c] @ self.b[d].T
        j, r = self.j.reshape(-1, 2), self.r.ravel()
        inverse = np.linalg.inv(covariance)
        inner = j.T @ inverse @ j
        projected = inverse - inverse @ j @ np.linalg.solve(inner, j.T @ inverse)
        return -0.5 * float(
            np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(inner)[1] + r @ projected @ r
        )


@given(seed=st.integers(0, 10_000), size=st.sampled_from([0.0, 10.0, 100.0]))
@settings(max_examples=15)
def test_the_evidence_is_the_mean_likelihood_over_the_grid_of_variances(seed: int, size: float) -> None:
    case = Case(seed, size)
    found = evidence(case.component, case.normal, case.phi)
    logs = np.array(
        [case.likelihood(u**2, v**2) for u in module._OWN for v in module._SHARED]
    ) - case.likelihood(0.0, 0.0)
    expected = logs.max() + np.log(np.mean(np.exp(logs - logs.max())))
    assert found.log_evidence == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_a_component_without_shared_features_has_only_its_own_variance() -> None:
    case = Case(3, 50.0, features=0)
    found = evidence(case.component, case.normal, case.phi)
    logs = np.array([case.likelihood(u**2, 0.0) for u in module._OWN]) - case.likelihood(0.0, 0.0)
    expected = logs.max() + np.log(np.mean(np.exp(logs - logs.max())))
    assert found.log_evidence == pytest.approx(expected, rel=1e-6)


def test_amplitudes_are_recovered_and_account_for_the_decrease_of_chi_squared() -> None:
    case = Case(5, 400.0)
    found = evidence(case.component, case.normal, case.phi)
    assert found.amplitudes == pytest.approx(case.truth, rel=0.1, abs=20.0)
    flat = case.j.reshape(-1, 2)

    def chi2(r: Floats) -> float:
        theta = np.linalg.lstsq(flat, r.ravel(), rcond=None)[0]
        return float(np.square(r.ravel() - flat @ theta).sum())

    fall = chi2(case.r) - chi2(case.r - np.einsum("cnk,ck->cn", case.b, found.amplitudes))
    assert found.explained == pytest.approx(fall, rel=1e-6)


def test_pure_noise_gives_no_evidence() -> None:
    logs = []
    for seed in range(40):
        case = Case(seed)
        logs.append(evidence(case.component, case.normal, case.phi).log_evidence)
    assert max(logs) < 3.0
    assert np.mean(np.array(logs) < 0.0) > 0.8
