"""Settings that do not repeat exactly, as unknowns: of each setting of a table, and of each record.

Of a table there is one for each setting, the error of the setting, shared by the rows set alike.
A gauge with an error, or a valve turned slightly too far, shifts all rows of one setting alike. It does not
affect the changes at a fixed setting, which such a table determines well.
"""

from __future__ import annotations

import math

import numpy as np

from rigctl.dataset.conditions import cluster
from rigctl.effects.record_level import RecordLevel, Setting
from rigctl.engine.least_squares import Unknown
from rigctl.model.fit.unknowns import setting_unknowns
from rigctl.model.inputs import input_sources
from rigctl.model.measured.record import Measurements
from rigctl.model.measured.table import column, set_variable
from rigctl.physics.family import ModelFamily
from rigctl.units import parse_unit

#: set values that differ by less than this share of the largest are one setting
_SAME = 0.01


def level_of_rows(level: RecordLevel, measurements: Measurements) -> tuple[RecordLevel, list[Unknown]]:
    """The record-level quantities with a level for each setting of a table, and these as unknowns.

    Measurements over time, and families in which nothing is set by hand, have none.
    """
    if level.setting is None or not measurements.table:
        return level, []
    points = np.unique(set_values(measurements, level.setting))
    if points.size < 2:
        return level, []
    extended = level.with_settings(points.tolist())
    return extended, setting_unknowns(extended, setting_std(measurements, level.setting))


def repeatability(measurements: Measurements, family: ModelFamily) -> dict[str, tuple[float, float]]:
    """The relative standard deviations of inputs that are set anew for each record, where the rig file states
    one of the single level that sets an input, each with the zero of that level's scale, SI."""
    rig = measurements.rig
    if rig is None or not family.generic:
        return {}
    levels = {
        source.input: rig.actuators[source.actuators[0][0]]
        for source in input_sources(family, rig)
        if len(source.actuators) == 1 and source.input not in measurements.unrecorded
    }
    return {
        name: (level.repeatability or 0.0, parse_unit(level.display_unit).to_si(0.0))
        for name, level in levels.items()
    }


def set_values(measurements: Measurements, setting: Setting) -> np.ndarray:
    """(rows) the set value of each row, SI; values meant to be the same are equal."""
    index = measurements.inputs.index(setting.input)
    values = [float(record.inputs[-1, index]) for record in measurements.records]
    return np.array(cluster(values, _SAME * max(map(abs, values))))


def setting_std(measurements: Measurements, setting: Setting) -> float:
    """Relative uncertainty of a setting: from the rig file, or larger if the rows show more."""
    usual = setting.std(measurements.rig)
    shown = setting_scatter(measurements, setting)
    return usual if shown is None else math.hypot(usual, shown)


def setting_scatter(measurements: Measurements, setting: Setting) -> float | None:
    """Relative scatter of the settings, estimated without any model of the bench.

    With ȳ_k the mean logarithm of the readings at setting u_k, over rows with other conditions that occur at
    every setting, the line ``ȳ = a + b·ln u`` leaves residuals e for n settings; a relative error s of a
    setting shifts ȳ by b·s, so ``s² = Σ e²/((n − 2)·b²)``.

    Returns
    -------
    None if fewer than three settings have rows in common, or the readings do not follow the setting.
    """
    # the logarithm makes a relative error of the setting a shift; only rows that occur at every setting may
    # be averaged, as the others would bring their own conditions into the means
    u = set_values(measurements, setting)
    y = column(measurements, 0)
    good = np.isfinite(y) & (y > 0.0) & (u > 0.0)
    name = set_variable(measurements)
    others = [
        tuple(f"{value:.5g}" for key, value in sorted(record.condition.items()) if key != name)
        for record in measurements.records
    ]
    points = np.unique(u[good])
    common = [
        one
        for one in dict.fromkeys(others)
        if all(any(good[k] and u[k] == point and others[k] == one for k in range(u.size)) for point in points)
    ]
    if points.size < 3 or not common:
        return None
    means = np.array(
        [
            np.mean(
                [math.log(y[k]) for k in range(u.size) if good[k] and u[k] == point and others[k] in common]
            )
            for point in points
        ]
    )
    matrix = np.column_stack([np.ones(points.size), np.log(points)])
    line = np.linalg.lstsq(matrix, means, rcond=None)[0]
    residuals = means - matrix @ line
    if abs(line[1]) < 0.05:
        return None
    return float(np.sqrt(residuals @ residuals / (points.size - 2)) / abs(line[1]))
