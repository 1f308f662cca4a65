"""The rigs that come with rigctl, each with a few records of its simulated bench as a basis for designs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from rigctl.analysis.comparison import compare
from rigctl.files.shipped import shipped
from rigctl.model import load_model
from rigctl.rig import load_rig
from rigctl.runner.simulation import simulate
from rigctl_validation.designed.rounds import Proposer


@dataclass(frozen=True)
class ShippedBench:
    """The first measurements on a rig, and what may be missing in its model.

    The true family is then the model's, whatever the rig file names.

    Attributes
    ----------
    procedure, arguments: of the first records.
    model: a shipped model file; its rig replaces the one that it names.
    effects: explanations besides the model itself, each at its usual size.
    """

    procedure: str
    model: str
    effects: tuple[str, ...]
    arguments: Mapping[str, str] = field(default_factory=dict)


_CYLINDER = ShippedBench(
    "campaign",
    "hl32-textbook",
    ("coulomb_friction", "valve_leakage", "position_thermal_drift", "spring_load"),
    {"temperatures": "20 degC", "pressures": "20 bar, 40 bar"},
)
_HEATERS = ShippedBench(
    "heater-board-steps",
    "heater-board",
    ("radiation", "heater_coupling"),
    {"powers": "20 %, 60 %", "dwell": "10 min"},
)
_CIRCUIT = ShippedBench("oil-circuit", "hl32-textbook", ("pump_slip", "relief_thermal_drift"))

BENCHES: Mapping[str, ShippedBench] = {
    "hl32-bench": _CYLINDER,
    "hl32-bench-instrumented": _CYLINDER,
    "hl32-bench-lines": _CYLINDER,
    "hl32-bench-uno": _CYLINDER,
    "heater-board": _HEATERS,
    "tclab-board": _HEATERS,
    "oil-circuit-modbus": _CIRCUIT,
    "oil-circuit-opcua": _CIRCUIT,
    "oil-circuit-visa": _CIRCUIT,
}


def proposer(name: str, folder: Path, seed: int = 1) -> Proposer:
    """All that may be proposed on a shipped rig after its first records, which are kept in `folder`.

    Raises
    ------
    RigctlError
        the bench cannot be simulated, or its records cannot be compared with the model.
    """
    known, path = BENCHES[name], shipped("rigs", f"{name}.yaml")
    rig = load_rig(path)
    model = replace(load_model(shipped("models", f"{known.model}.yaml")), rig=rig)
    run = simulate(
        shipped("procedures", f"{known.procedure}.yaml"),
        rig=path,
        arguments=known.arguments,
        seed=seed,
        runs=folder,
    ).run
    (compared,) = compare([run], [model]).models
    return Proposer.after(compared, rig, known.effects)
