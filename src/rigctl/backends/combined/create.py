"""Makes one bench of the several devices of a rig file."""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.backends.combined.bench import CombinedBench
from rigctl.backends.registry import addresses_with, create_backend, options_of_device
from rigctl.clock import Clock
from rigctl.rig import DEVICES, Rig


def create(rig: Rig, clock: Clock, options: Mapping[str, object]) -> CombinedBench:
    """Make a bench of several devices, not yet open.

    Parameters
    ----------
    rig: its ``devices``.
    clock: real.
    options: ``port`` (addresses by device, instead of those of the rig file), ``clear_trips`` (on or off, of
        rigctl's own boards).

    Raises
    ------
    RigctlError
        an option is unknown or wrong, or two devices are at one address.
    """
    addresses = addresses_with(rig, DEVICES, options)
    benches = {
        name: create_backend(part, None, clock, options_of_device(rig, name, options))
        for name, part in rig.parts.items()
    }
    places = {name: address.url for name, address in addresses.items()}
    return CombinedBench(rig, clock, benches, places)
