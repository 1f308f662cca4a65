"""The separate bench behind a rig file: a backend on which procedures are carried out, as on a real one.

A complete campaign (`rigctl_validation.campaign_run`) cannot answer new questions. Here the runner opens,
switches and samples the separate bench, on a virtual clock.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from rigctl.backends.simulated.bench import SimulatedBench
from rigctl.backends.simulated.device import Device
from rigctl.backends.simulated.imperfections import Imperfections
from rigctl.backends.simulated.initial import initial_commands, initial_values
from rigctl.backends.simulated.link import Link
from rigctl.clock import Clock, VirtualClock
from rigctl.dataset import RunWriter
from rigctl.errors import RigctlError
from rigctl.plan import Plan
from rigctl.procedure import expand, load_procedure
from rigctl.rig import Rig, load_rig
from rigctl.runner.launch import Launch, carry_out, header_of
from rigctl.runner.operators.automatic_operator import AutomaticOperator
from rigctl.runner.session import RunResult
from rigctl_validation.bench.campaign import Campaign
from rigctl_validation.bench.record import Condition
from rigctl_validation.bench.running import RunningBench
from rigctl_validation.bench.sensing import CHANNELS


class SeparatePlant:
    """The separate bench as the simulated backend's plant; its sensors and their noise are its own.

    Parameters
    ----------
    rig: one of the cylinder's, with a heater, a directional valve and a relief valve in their roles.
    bench: in its current state.

    Raises
    ------
    RigctlError
        the rig belongs to another bench.
    """

    def __init__(self, rig: Rig, bench: RunningBench) -> None:
        roles = rig.roles
        unknown = [name for name in rig.channels if name not in CHANNELS]
        if unknown or roles.extend is None or roles.set_pressure is None or roles.heat is None:
            raise RigctlError(
                "the rig is not the bench that is simulated",
                value=rig.name,
                expected=f"no channels but {', '.join(CHANNELS)}, and roles for heat, pressure and motion",
            )
        self.channels: tuple[str, ...] = rig.layout.channels
        self._bench = bench
        self._valve, self._relief = roles.extend.actuator, roles.set_pressure.actuator
        self._heater = roles.heat.actuator
        self._power = float(rig.actuators[self._heater].power or 0.0)
        bench.relief(initial_commands(rig)[self._relief])

    def advance(self, time: float) -> None:
        """Let the bench run to `time`."""
        self._bench.advance(time)

    def switch(self, actuator: str, value: float) -> None:
        """Set an actuator to an SI value."""
        if actuator == self._valve:
            self._bench.valve(value)
        elif actuator == self._relief:
            self._bench.relief(value)
        elif actuator == self._heater:
            self._bench.heat(value * self._power)

    def drives(self, actuator: str) -> bool:
        """Whether it is the valve, the relief valve or the heater."""
        return actuator in (self._valve, self._relief, self._heater)

    def read(self) -> Sequence[float]:
        """The readings of its sensors, SI: each sample's noise is drawn once."""
        shown = self._bench.read()
        return [shown[name] for name in self.channels]

    def take_departures(self) -> Sequence[str]:
        """None: it uses none of rigctl's laws."""
        return ()


def live_bench(campaign: Campaign, rig: Rig, clock: Clock) -> SimulatedBench:
    """An unopened backend with the bench of `campaign`, cold and retracted as in the rig file.

    It adds neither noise nor quantisation to those of the campaign's own sensors.
    """
    initial = initial_values(rig)
    condition = Condition(
        oil=initial["oil_temperature"],
        setting=initial["supply_pressure"],
        ambient=rig.simulation.ambient_temperature,
    )
    flaws = Imperfections(seed=campaign.seed, noise=False, quantised=False)

    def switch_on() -> Device:
        plant = SeparatePlant(rig, RunningBench(campaign, condition))
        return Device(rig, plant, initial_commands(rig), flaws)

    return SimulatedBench(
        rig, clock, switch_on, Link(()), {"plant": "separate bench", "seed": str(campaign.seed)}
    )


@dataclass(frozen=True)
class SeparateBench:
    """The separate bench for learning: each round starts cold, with independent noise.

    Parameters
    ----------
    campaign: the bench with its hidden effects.
    rig: the rig file.
    runs: the folder of the runs.
    """

    campaign: Campaign
    rig: Path
    runs: Path

    def plan(self, procedure: Path, arguments: Mapping[str, str]) -> Plan:
        """The procedure on this rig."""
        return expand(load_procedure(procedure), load_rig(self.rig), dict(arguments))

    def measure(self, plan: Plan, number: int, since: str) -> RunResult:
        """Carry it out as a new run, in virtual time."""
        clock = VirtualClock(started=datetime.now(UTC))
        backend = live_bench(replace(self.campaign, seed=1000 * self.campaign.seed + number), plan.rig, clock)
        how = Launch(runs=self.runs, operator=AutomaticOperator(), clock=clock, exclusive=False)
        backend.open()
        try:
            writer = RunWriter.create(self.runs, header_of(plan, backend, how))
            return carry_out(plan, backend, writer, None, how)
        finally:
            backend.close()
