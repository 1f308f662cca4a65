"""Makes a VISA bench from a rig file and command options."""

from __future__ import annotations

from collections.abc import Mapping

from rigctl.backends.lines.create import line_bench
from rigctl.backends.options import read_port, refuse_unknown, require_packages
from rigctl.backends.protocol import Backend
from rigctl.backends.transport.address import Address
from rigctl.clock import Clock
from rigctl.errors import RigctlError
from rigctl.rig import Lines, Rig
from rigctl.rig.rates import BAUDS

OPTIONS = ("port", "baud", "library")


def create(rig: Rig, clock: Clock, options: Mapping[str, object]) -> Backend:
    """Make a VISA bench, not yet open.

    Parameters
    ----------
    rig: its ``backend.lines`` gives the messages and the meaning of the answers.
    clock: real.
    options: ``port`` (a VISA resource name), ``baud`` (of a serial line), ``library`` (PyVISA's: ``@py`` for
        pyvisa-py, the default, ``@ivi`` for an installed VISA, or its file).

    Raises
    ------
    RigctlError
        as `address_of`.
    """
    return line_bench(rig, _lines(rig).of_a_client, clock, address_of(rig, options))


def address_of(rig: Rig, options: Mapping[str, object]) -> Address:
    """Return the address of the instrument, with its message terminators.

    Raises
    ------
    RigctlError
        an option is unknown or wrong, no port is named, or PyVISA is missing.
    """
    refuse_unknown("option of the visa backend", options, OPTIONS)
    expected = "e.g. '--port TCPIP::192.168.0.21::5025::SOCKET', or GPIB0::9::INSTR"
    port = read_port(rig, options, "which instrument?", expected)
    library = options.get("library") or "@py"
    needed = ("pyvisa", "pyvisa_py") if library == "@py" else ("pyvisa",)
    require_packages("an instrument behind VISA", "PyVISA", "visa", needed)
    lines = _lines(rig)
    settings = {
        "library": str(library),
        "timeout": lines.timeout,
        "baud": options.get("baud") or rig.backend.baud or BAUDS["visa"],
        "frame": lines.frame,
        "send_ends": lines.send_ends,
        "reply_ends": lines.reply_ends,
        "identify": None if lines.identify is None else lines.identify.send,
    }
    return Address("visa", port, settings)


def _lines(rig: Rig) -> Lines:
    if rig.backend.lines is None:
        raise RigctlError(f"the rig '{rig.name}' describes no lines", expected="'backend: {lines: …}'")
    return rig.backend.lines
