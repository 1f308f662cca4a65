"""Makes an emulated board on a simulated bench from a rig file and command options."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rigctl.backends.arduino.bench import ArduinoBench
from rigctl.backends.arduino.wiring import wiring_of
from rigctl.backends.emulated.board import EmulatedBoard
from rigctl.backends.emulated.image import read_intel_hex, shipped_image
from rigctl.backends.emulated.library import load_libraries
from rigctl.backends.emulated.port import EmulatedPort
from rigctl.backends.options import read_flag, refuse_unknown
from rigctl.backends.protocol import Backend
from rigctl.backends.simulated.create import OPTIONS as OF_THE_BENCH
from rigctl.backends.simulated.create import Prepared, prepare
from rigctl.backends.simulated.link import Link
from rigctl.backends.transport.port import Port
from rigctl.clock import Clock
from rigctl.rig import Rig
from rigctl.rig.rates import BAUDS

OPTIONS = (*OF_THE_BENCH, "inputs", "outputs", "baud", "image", "clear_trips")


def create(rig: Rig, clock: Clock, options: Mapping[str, object]) -> Backend:
    """Make a bench with the firmware on an emulated microcontroller that follows `clock`; not yet open.

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
    wiring, baud = wiring_of(rig, options), _baud(rig, options)
    program = _program(options, baud)
    bench = _bench(rig, options)
    switched_on: list[tuple[EmulatedBoard, float]] = []

    def connect() -> Port:
        if not switched_on:
            origin = clock.now()
            switched_on.append((EmulatedBoard(rig, wiring, program, bench.switch_on()), origin))
        board, origin = switched_on[0]
        port = EmulatedPort(board, clock, origin, Link(bench.faults))
        port.read(clock.now())  # raises at once if the line is dead
        return port

    def by_hand(actuator: str, value: float) -> None:
        board, _ = switched_on[0]
        board.device.command(actuator, value, board.time, None)

    clear = read_flag("clear_trips", options.get("clear_trips"), default=False)
    if rig.backend.lines is not None:
        from rigctl.backends.lines.bench import LineBench

        return LineBench(
            rig,
            rig.backend.lines,
            clock,
            connect,
            kind="emulated",
            identity=bench.identity,
            by_hand=by_hand,
            without_host=ArduinoBench.without_host,
        )
    return ArduinoBench(
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


def make_board(rig: Rig, options: Mapping[str, object]) -> EmulatedBoard:
    """Make only the board, switched on, for a client other than rigctl; options as for `create`.

    Raises
    ------
    RigctlError
        as `create`.
    """
    refuse_unknown("option of the emulated backend", options, OPTIONS)
    load_libraries()
    program = _program(options, _baud(rig, options))
    return EmulatedBoard(rig, wiring_of(rig, options), program, _bench(rig, options).switch_on())


def _baud(rig: Rig, options: Mapping[str, object]) -> int:
    baud = options.get("baud") or rig.backend.baud or BAUDS["emulated"]
    return baud if isinstance(baud, int) else 0


def _program(options: Mapping[str, object], baud: int) -> bytes:
    image = options.get("image")
    return read_intel_hex(Path(str(image)) if image else shipped_image(baud))


def _bench(rig: Rig, options: Mapping[str, object]) -> Prepared:
    return prepare(rig, {name: value for name, value in options.items() if name in OF_THE_BENCH})
