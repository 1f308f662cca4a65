"""Pairs of effects on the linear problem."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from rigctl.analysis.linear.candidates import Candidate
from rigctl.analysis.linear.linearisation import Linearisation, RecordTriangle
from rigctl.analysis.linear.nuisance_projection import project
from rigctl.analysis.linear.pair_gains import pair_gains
from rigctl.analysis.linear.regions import Regions
from rigctl.effects.registry import library
from rigctl.physics.families import find_family

ROWS = 60


def one_column(effect: str, parameter: str, shapes: dict[str, float] | None = None) -> Candidate:
    declared = library(find_family("hydraulic_cylinder"))[effect]
    return Candidate(declared, (f"{effect}.{parameter}",), (0,), shapes or {})


def test_each_pair_of_effects_is_listed_once_whatever_its_shapes() -> None:
    rng = np.random.default_rng(5)
    lag, leak, load = rng.standard_normal((3, ROWS))
    shapes = [
        one_column("wall_heat_capacity", "share", {"wall_heat_capacity.time": 20.0 * k}) for k in range(6)
    ]
    candidates = (
        *shapes,
        one_column("piston_leakage", "conductance"),
        one_column("constant_load", "force"),
    )
    alike = [lag + 0.02 * rng.standard_normal(ROWS) for _ in shapes]
    triangle = RecordTriangle(
        np.empty((ROWS, 0)),
        np.column_stack([*alike, leak, load]),
        np.empty((ROWS, 0)),
        5.0 * lag + 4.0 * leak + 3.0 * load,
        ROWS,
    )
    problem = SimpleNamespace(
        measurements=SimpleNamespace(table=False), compiled=SimpleNamespace(cascade=None)
    )
    fit: Any = SimpleNamespace(problem=problem)
    sizes = np.linalg.norm(triangle.signatures, axis=0)
    lin = Linearisation(
        fit,
        candidates,
        tuple(range(len(candidates))),
        (),
        cast("Regions", None),
        (triangle,),
        sizes,
        (np.empty((0, 0)), np.empty(0)),
    )
    found = pair_gains(project(lin))
    names = [{candidates[place].name for place in pair.candidates} for pair in found]
    assert names == [
        {"wall_heat_capacity", "piston_leakage"},
        {"wall_heat_capacity", "constant_load"},
        {"piston_leakage", "constant_load"},
    ]
    assert all(one.gain > other.gain for one, other in pairwise(found))
