"""Make an emulated board on a simulated bench from a rig file and the options of a command."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rigctl.backends.emulated.board import EmulatedBoard
from rigctl.backends.emulated.image import read_intel_hex, shipped_image
from rigctl.backends.emulated.library import load_libraries
from rigctl.backends.emulated.port import EmulatedPort
from rigctl.backends.options import read_flag, refuse_unknown
from rigctl.backends.serial.bench import SerialBench
from rigctl.backends.serial.port import Port
from rigctl.backends.serial.wiring import wiring_of
from rigctl.backends.simulated.create import OPTIONS as OF_THE_BENCH
from rigctl.backends.simulated.create import prepare
from rigctl.backends.simulated.link import Link
from rigctl.clock import Clock
from rigctl.rig import Rig

OPTIONS = (*OF_THE_BENCH, "inputs", "outputs", "baud", "image", "clear_trips")


def create(rig: Rig, clock: Clock, options: Mapping[str, object]) -> SerialBench:
    """The board's firmware on an emulated microcontroller, in step with `clock`; not yet open.

    Parameters
    ----------
    rig: as for the serial backend.
    clock: virtual, scaled or real.
    options: those of the simulated bench, and those of the serial backend but ``port``; ``image`` (an Intel
        HEX file) instead of the firmware that comes with rigctl.

    Raises
    ------
    RigctlError
        an option is unknown or wrong, or simavr is missing.
    """
    refuse_unknown("option of the emulated backend", options, OPTIONS)
    load_libraries()
    wiring = wiring_of(rig, options)
    baud = options.get("baud") or rig.backend.baud or 115200
    baud = baud if isinstance(baud, int) else 0
    image = options.get("image")
    program = read_intel_hex(Path(str(image)) if image else shipped_image(baud))
    bench = prepare(rig, {name: value for name, value in options.items() if name in OF_THE_BENCH})
    switched_on: list[tuple[EmulatedBoard, float]] = []

    def connect() -> Port:
        if not switched_on:
            origin = clock.now()
            switched_on.append((EmulatedBoard(rig, wiring, program, bench.switch_on()), origin))
        board, origin = switched_on[0]
        port = EmulatedPort(board, clock, origin, Link(bench.faults))
        port.read(clock.now())  # a line that is dead is noticed at once
        return port

    def by_hand(actuator: str, value: float) -> None:
        board, _ = switched_on[0]
        board.device.command(actuator, value, board.time, None)

    clear = read_flag("clear_trips", options.get("clear_trips"), default=False)
    return SerialBench(
        rig,
        clock,
        connect,
        wiring,
        kind="emulated",
        baud=baud,
        clear_trips=clear,
        identity=bench.identity,
        by_hand=by_hand,
    )
