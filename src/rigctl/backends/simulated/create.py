"""Makes a simulated bench from a rig file and command options."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from rigctl.backends.options import read_flag, read_texts, refuse_unknown
from rigctl.backends.simulated.bench import SimulatedBench
from rigctl.backends.simulated.device import Device
from rigctl.backends.simulated.faults import Fault, parse_fault
from rigctl.backends.simulated.imperfections import Imperfections
from rigctl.backends.simulated.initial import initial_commands, initial_values
from rigctl.backends.simulated.link import Link
from rigctl.backends.simulated.plant import Plant
from rigctl.backends.simulated.roles_plant import RolesPlant
from rigctl.clock import Clock
from rigctl.errors import RigctlError
from rigctl.rig import Rig

OPTIONS = ("seed", "noise", "quantised", "faults", "plant", "effects", "progress")

#: the plant without a model
PLAIN = "roles"


def create(rig: Rig, clock: Clock, options: Mapping[str, object]) -> SimulatedBench:
    """Make a simulated bench, not yet open.

    Parameters
    ----------
    rig: its ``simulation`` part has the defaults of the options.
    clock: virtual, scaled or real.
    options: any of
        ``seed`` (a whole number, not negative);
        ``noise``, ``quantised`` (on or off);
        ``faults`` (texts for `parse_fault`);
        ``plant`` (a model file as the truth, or ``roles`` for the plain plant; by default the rig's model
        family, or the plain plant if it has none);
        ``effects`` (texts such as ``piston_leakage:clearance=30 um``, hidden in the plant);
        ``progress`` (called when something takes long).

    Raises
    ------
    RigctlError
        an option is unknown or wrong.
    """
    bench = prepare(rig, options)
    return SimulatedBench(rig, clock, bench.switch_on, Link(bench.faults), bench.identity)


@dataclass(frozen=True)
class Prepared:
    """A simulated bench without host and clock, ready to be switched on; also used by the emulated board."""

    switch_on: Callable[[], Device]
    faults: tuple[Fault, ...]
    identity: Mapping[str, str]


def prepare(rig: Rig, options: Mapping[str, object]) -> Prepared:
    """Prepare the device for the options of `create`.

    Raises
    ------
    RigctlError
        an option is unknown or wrong.
    """
    refuse_unknown("option of the simulated bench", options, OPTIONS)
    flaws = Imperfections(
        seed=_seed(options.get("seed"), rig.simulation.seed),
        noise=read_flag("noise", options.get("noise"), default=rig.simulation.noise),
        quantised=read_flag("quantised", options.get("quantised"), default=True),
        scatter=dict(rig.simulation.scatter),
        answer_delay=rig.simulation.answer_delay,
        faults=tuple(parse_fault(text, rig) for text in read_texts("faults", options.get("faults"))),
    )
    make_plant, plant_name = _choose_plant(rig, options)

    def switch_on() -> Device:
        return Device(rig, make_plant(), initial_commands(rig), flaws)

    identity = {
        "plant": plant_name,
        "seed": str(flaws.seed),
        "noise": "on" if flaws.noise else "off",
        "faults": ", ".join(str(fault) for fault in flaws.faults) or "none",
    }
    return Prepared(switch_on, flaws.faults, identity)


def _seed(given: object, default: int) -> int:
    if given is None:
        return default
    if isinstance(given, int) and not isinstance(given, bool) and given >= 0:
        return given
    raise RigctlError("not a seed", value=str(given), expected="a whole number, 0 or more")


def _choose_plant(rig: Rig, options: Mapping[str, object]) -> tuple[Callable[[], Plant], str]:
    """Return a function that makes the plant when the bench is opened, and its description."""
    choice = options.get("plant")
    effects = read_texts("effects", options.get("effects"))
    if choice == PLAIN or (choice is None and rig.model is None):
        if effects:
            raise RigctlError(
                "effects need a plant with a model",
                value=effects[0],
                expected="'model: …' in the rig file, or a model file",
            )
        ambient = rig.simulation.ambient_temperature
        return lambda: RolesPlant(rig, initial_values(rig), ambient), RolesPlant.description
    from rigctl.backends.simulated.truth import describe, read_truth

    truth = read_truth(rig, None if choice is None else Path(str(choice)), effects)
    progress = options.get("progress")

    def make() -> Plant:
        from rigctl.backends.simulated.model_plant import ModelPlant

        return ModelPlant(rig, truth, progress if callable(progress) else None)

    return make, describe(truth)
