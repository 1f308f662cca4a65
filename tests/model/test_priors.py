"""Priors of a model file: read, preserved by fits, and weighted with the data."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from rigctl.engine.least_squares import Block, Prior, Unknown, least_squares
from rigctl.errors import RigctlError
from rigctl.files.shipped import shipped
from rigctl.model import load_model
from rigctl.model.fit.approach import approach
from rigctl.model.fit.unknowns import shared_unknowns
from rigctl.model.load import parse_model
from rigctl.model.writing.update import updated_text

TEXTBOOK = shipped("models", "hl32-textbook.yaml")


def test_a_prior_is_read_in_si_and_used_by_every_fit() -> None:
    model = load_model(TEXTBOOK)
    assert model.parameters["dead_volume_a"].prior == Prior(pytest.approx(60e-6), pytest.approx(15e-6))
    assert model.parameters["flow_area"].prior is None
    unknowns = {unknown.name: unknown for unknown in shared_unknowns(model)}
    assert unknowns["moving_mass"].prior == Prior(12.0, 2.0)
    assert unknowns["viscous_damping"].prior is None


def test_a_fit_changes_the_value_and_not_the_prior() -> None:
    model = load_model(TEXTBOOK).with_values({"moving_mass": 13.5}, std={"moving_mass": 0.4}, source="a fit")
    again = parse_model(updated_text(model, TEXTBOOK), TEXTBOOK)
    mass = again.parameters["moving_mass"]
    assert (mass.si, mass.std, mass.prior) == (13.5, 0.4, Prior(12.0, 2.0))


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("{value: 12 kg, std: 0 kg}", "above zero"),
        ("{value: 12 kg, std: 2 mm}", "wrong dimension, got '2 mm'; expected a mass"),
        ("{value: -3 kg, std: 2 kg}", "out of bounds"),
        ("{value: 12 kg}", "the field 'std' is missing"),
    ],
)
def test_an_invalid_prior_is_refused(written: str, said: str, tmp_path: Path) -> None:
    text = TEXTBOOK.read_text(encoding="utf-8").replace("{value: 12 kg, std: 2 kg}", written)
    with pytest.raises(RigctlError, match=said):
        parse_model(text, TEXTBOOK)


def beats(shared: np.ndarray, _: Sequence[np.ndarray], derivatives: bool) -> list[Block]:
    """A level far off, and an undersampled oscillation with many local minima."""
    level, frequency = shared
    times = np.linspace(0.5, 1.0, 6)
    ring = np.cos(2 * np.pi * frequency * times) - np.cos(2 * np.pi * 50.0 * times)
    slope = -2 * np.pi * times * np.sin(2 * np.pi * frequency * times)
    residual = np.concatenate([np.full(40, (level - 100.0) / 0.01), 20.0 * ring])
    columns = np.zeros((residual.size, 2))
    columns[:40, 0] = 100.0
    columns[40:, 1] = 20.0 * slope
    return [Block(residual, columns if derivatives else None, np.zeros((residual.size, 0)))]


def test_a_bad_start_of_one_parameter_does_not_affect_the_others() -> None:
    """However far off the level is, the prior keeps the frequency near its minimum."""
    unknowns = [
        Unknown("level", 10.0, 0.0, 1e3),
        Unknown("frequency", 50.02, 1.0, 200.0, prior=Prior(50.02, 0.05)),
    ]
    begun, own = approach(beats, unknowns, [[]])
    assert begun[0].start == pytest.approx(100.0, abs=0.1)
    assert begun[1].start == pytest.approx(50.0, abs=0.1)
    assert own == [[]]
    found = least_squares(beats, begun, own)
    assert found.values == pytest.approx([100.0, 50.0], rel=1e-3)
