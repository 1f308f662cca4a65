"""The ten benches by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from rigctl.errors import unknown_name
from rigctl_validation.benches import (
    battery,
    belt,
    chain,
    chamber,
    exchanger,
    motor,
    pendulum,
    pump,
    spring,
    tanks,
)
from rigctl_validation.benches.bench import SmallBench

_MODULES = (motor, tanks, spring, pendulum, chain, exchanger, chamber, pump, battery, belt)

BENCHES: Final[Mapping[str, SmallBench]] = {module.BENCH.name: module.BENCH for module in _MODULES}


def find_bench(name: str) -> SmallBench:
    """The bench of this name.

    Raises
    ------
    RigctlError
        there is none.
    """
    if name not in BENCHES:
        raise unknown_name("bench", name, BENCHES)
    return BENCHES[name]
