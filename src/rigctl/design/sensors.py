"""Which sensor would distinguish the rivals: the same distances with channels that the bench could have.

In: the criterion of a design, the rig with its possible sensors, and records. Out: a `SensorSet` for one or
two of them at a time, with price and power. The records are the proposed ones and a repetition of the
earlier ones: the power with a sensor is compared with that without.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rigctl.design.criterion import Discrimination
from rigctl.design.information import Evidence
from rigctl.design.power import Gain
from rigctl.design.refitted_gain import TAKEN_UP, refitted_gain
from rigctl.design.result import SensorSet
from rigctl.design.rivals import Rival
from rigctl.design.virtual_records import Scene, predict
from rigctl.errors import RigctlError, unknown_name
from rigctl.model.fit.problem import Problem
from rigctl.model.measured.record import MeasuredRecord, Measurements
from rigctl.model.model import Model
from rigctl.noise import ChannelNoise
from rigctl.noise.whitening import whiten
from rigctl.physics.family import Formula, ModelFamily, OutputVariable
from rigctl.physics.si_unit import si_unit
from rigctl.rig.possible_sensors import PossibleChannel
from rigctl.rig.rig import Rig

Floats = NDArray[np.float64]

#: largest number of sensors in one set
_TOGETHER = 2
#: a pair counts as distinguished from this probability on
_DISTINGUISHED = 0.5


def sensor_sets(
    criterion: Discrimination, rig: Rig, records: Sequence[MeasuredRecord]
) -> tuple[SensorSet, ...]:
    """Every set of up to two sensors that the rig could have, and the bench as it is, the cheapest first.

    Parameters
    ----------
    records: with their readings in the existing channels.
    """
    # All possible sensors are put on the bench at once, and simulated once with each rival; a set of them is
    # then a choice of rows, whitened in its own noise.
    unknown = unknown_sensors(criterion, rig)
    names = tuple(name for name in _missing(rig) if name not in unknown)
    if not names:
        return ()
    rivals = [_equipped(rival, rig, names) for rival in criterion.question.rivals]
    scenes = predict(rivals, [_wider(record, len(names)) for record in records])
    criterion = _with_every_sensor(criterion, rivals, [scene for scene in scenes if scene is not None])
    present = len(criterion.question.rivals[0].fit.problem.measurements.outputs)
    plain = _probabilities(criterion, _evidence(scenes, rivals[0], range(present)))
    sets = [
        _of_set(criterion, rig, chosen, plain, _evidence(scenes, rivals[0], [*range(present), *indices]))
        for count in range(1, _TOGETHER + 1)
        for chosen, indices in _choices(names, present, count)
    ]
    return tuple(sorted(sets, key=lambda one: (one.price is None, one.price or 0.0, one.channels)))


def unknown_sensors(criterion: Discrimination, rig: Rig) -> dict[str, str]:
    """The sensors that the rig could have and some model cannot read, and why: it lacks what they measure."""
    families = [rival.fit.problem.model.family for rival in criterion.question.rivals]
    unknown = {}
    for name, sensor in _missing(rig).items():
        for family in families:
            try:
                _read(family, name, sensor)
            except RigctlError as error:
                unknown[name] = str(error)
    return unknown


def _missing(rig: Rig) -> dict[str, PossibleChannel]:
    return {name: sensor for name, sensor in rig.could_have.items() if name not in rig.channels}


def _with_every_sensor(
    criterion: Discrimination, rivals: Sequence[Rival], scenes: Sequence[Scene]
) -> Discrimination:
    """The criterion, with the share of each distance that rivals leave with all sensors, if they absorb it
    without any.

    A pair that is not distinguished with all sensors is not distinguished with any subset.
    """
    # A rival may absorb the new records without further sensors and not with them: the share that a refit
    # leaves is computed with all sensors, as an upper bound for every set.
    linear = replace(criterion, reach={}).distances(
        Evidence.total(Evidence.of(one.responses) for one in scenes)
    )
    reach = dict(criterion.reach)
    for truth, rival in criterion.pairs:
        factor = criterion.question.rivals[truth].overdispersion
        if criterion.reach.get((truth, rival), 0.0) < TAKEN_UP and linear[truth, rival] > 0.0:
            gained = refitted_gain(rivals[rival], truth, scenes) / factor
            reach[truth, rival] = min(gained / float(linear[truth, rival]), 1.0)
    return replace(criterion, reach=reach)


def best_sensor(sets: Sequence[SensorSet]) -> SensorSet | None:
    """The set with the largest probability; of those with nearly the same, the cheapest."""
    if not sets:
        return None
    most = max(one.probability for one in sets)
    distinguished = max(one.distinguished for one in sets)
    good = [
        one
        for one in sets
        if one.probability >= 0.95 * most and (most >= _DISTINGUISHED or one.distinguished == distinguished)
    ]
    return good[0] if good else max(sets, key=lambda one: one.probability)


def _choices(names: Sequence[str], present: int, count: int) -> list[tuple[tuple[str, ...], tuple[int, ...]]]:
    """(names, their indices among the channels) of every set of this size."""
    return [
        (tuple(names[k] for k in chosen), tuple(present + k for k in chosen))
        for chosen in combinations(range(len(names)), count)
    ]


def _of_set(
    criterion: Discrimination,
    rig: Rig,
    chosen: tuple[str, ...],
    plain: dict[tuple[int, int], float],
    evidence: Evidence,
) -> SensorSet:
    probabilities = _probabilities(criterion, evidence)
    prices = [rig.could_have[name].price for name in chosen]
    known = [price for price in prices if price is not None]
    rivals = criterion.question.rivals
    pairs = _pairs(probabilities)
    return SensorSet(
        channels=chosen,
        price=sum(price.amount for price in known) if len(known) == len(prices) else None,
        currency=known[0].currency if known else "",
        distinguished=sum(pairs.values()),
        of=len(pairs),
        separation=criterion.separation(evidence),
        probability=criterion.together(probabilities),
        splits=tuple(
            (rivals[one].name, rivals[other].name)
            for (one, other), apart in pairs.items()
            if apart and not _pairs(plain)[one, other]
        ),
    )


def _probabilities(criterion: Discrimination, evidence: Evidence) -> dict[tuple[int, int], float]:
    """P of each ordered pair, at the rivals' fits."""
    distances = criterion.distances(evidence)
    return {
        pair: criterion.of_pair(pair, Gain(distances[pair][None], distances[pair][None]), distances)
        for pair in criterion.pairs
    }


def _pairs(probabilities: dict[tuple[int, int], float]) -> dict[tuple[int, int], bool]:
    """Each pair once: whether it is distinguished, whichever of the two is right.

    Where one of two models has something in addition, only that this is there can be shown.
    """
    both = {
        (one, other): min(probabilities[one, other], probabilities[other, one]) >= _DISTINGUISHED
        for one, other in probabilities
        if one < other and (other, one) in probabilities
    }
    return both or {pair: probability >= _DISTINGUISHED for pair, probability in probabilities.items()}


def _evidence(scenes: Sequence[Scene | None], first: Rival, channels: Sequence[int]) -> Evidence:
    """The evidence of all records in some of their channels."""
    indices = list(channels)
    noise = first.fit.problem.noise
    some = replace(noise, channels=tuple(noise.channels[k] for k in indices))
    evidence = []
    for scene in scenes:
        if scene is None:
            continue
        ok = np.ones((scene.record.times.size, len(indices)), dtype=bool)
        sigma = scene.sigma[:, indices]
        whitener = whiten(some, scene.record.times, ok, scene.record.values[:, indices], sigma=sigma)
        responses = [one.of_channels(indices).response(whitener) for one in scene.predicted]
        evidence.append(Evidence.of(responses))
    return Evidence.total(evidence)


# --- a bench with more channels


def _equipped(rival: Rival, rig: Rig, names: Sequence[str]) -> Rival:
    """The rival on a bench that also has these sensors."""
    sensors = {name: rig.could_have[name] for name in names}
    # The model gets more outputs, the data columns without readings: everything that was fitted stays as it
    # is.
    known = rival.fit.problem
    model = _with_outputs(known.model, sensors)
    equipped = _with_channels(known.measurements, rig, sensors)
    noise = replace(
        known.noise,
        channels=(
            *known.noise.channels,
            *(ChannelNoise(name, float(one.noise), source="rig") for name, one in sensors.items()),
        ),
    )
    ok = [np.hstack([good, np.zeros((len(good), len(names)), dtype=bool)]) for good in known.ok]
    wider = replace(known, measurements=equipped, signal=None, scatter=None, extra=None, grown=None)
    extended = wider.for_model(replace(model, rig=equipped.rig), noise, ok)
    extended = extended.with_shared(known.shared, _values_of(extended, known))
    return replace(rival, trial=replace(rival.trial, fit=replace(rival.fit, problem=extended)))


def _values_of(extended: Problem, known: Problem) -> Floats:
    """The parameters for a system with more outputs, which has the same ones."""
    at = dict(zip(known.compiled.system.parameter_names, known.base.tolist(), strict=True))
    names = extended.compiled.system.parameter_names
    return np.array([at.get(name, value) for name, value in zip(names, extended.base.tolist(), strict=True)])


def _with_outputs(model: Model, sensors: dict[str, PossibleChannel]) -> Model:
    """The model with a family that has the sensors as outputs, with exact derivatives like any other."""
    known = {output.name for output in model.family.outputs}
    more = [
        OutputVariable(name, *_read(model.family, name, sensor))
        for name, sensor in sensors.items()
        if name not in known or sensor.reads not in ("", name)
    ]
    replaced = {one.name for one in more}
    unchanged = [output for output in model.family.outputs if output.name not in replaced]
    return replace(model, family=replace(model.family, outputs=(*unchanged, *more)))


def _read(family: ModelFamily, name: str, sensor: PossibleChannel) -> tuple[str, Formula, str]:
    """Unit, formula and meaning of a sensor's reading.

    Raises
    ------
    RigctlError
        the family lacks the quantity that it is declared to measure.
    """
    wanted = sensor.reads or name
    read = {output.name: output for output in family.outputs}
    if wanted in read:  # a second sensor for the same reading
        return si_unit(read[wanted].unit), read[wanted].formula, sensor.description
    units = {state.name: state.unit for state in family.states}
    units |= {item.name: item.unit for item in family.inputs}
    units |= {definition.name: definition.unit for definition in family.definitions}
    if wanted not in units:
        raise unknown_name(
            f"quantity of the model that the sensor '{name}' could read", wanted, [*units, *read]
        )
    return si_unit(units[wanted]), lambda m: m[wanted], sensor.description


def _with_channels(measurements: Measurements, rig: Rig, sensors: dict[str, PossibleChannel]) -> Measurements:
    present = measurements.rig or rig
    channels = {**present.channels, **{name: one.channel for name, one in sensors.items()}}
    return replace(
        measurements,
        outputs=(*measurements.outputs, *sensors),
        units=(*measurements.units, *(one.unit for one in sensors.values())),
        records=tuple(_wider(record, len(sensors)) for record in measurements.records),
        rig=present.model_copy(update={"channels": channels}),
    )


def _wider(record: MeasuredRecord, count: int) -> MeasuredRecord:
    """A record with additional columns for channels that were not read."""
    nothing = np.full((len(record.values), count), np.nan)
    return replace(record, values=np.hstack([record.values, nothing]))
