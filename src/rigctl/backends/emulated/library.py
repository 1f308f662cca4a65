"""simavr through ctypes. Under GPL-3, it is loaded at run time from the system's package, never bundled."""

from __future__ import annotations

import ctypes as c
import ctypes.util
import sys
from dataclasses import dataclass
from functools import cache
from typing import Any

from rigctl.errors import RigctlError

INSTALL = "sudo apt-get install libsimavr2"

#: states of the core (sim_avr.h); `LIMBO` is 0
LIMBO, STOPPED, RUNNING, SLEEPING, STEP, STEP_DONE, DONE, CRASHED = range(8)

IrqCallback = c.CFUNCTYPE(None, c.c_void_p, c.c_uint32, c.c_void_p)
TimerCallback = c.CFUNCTYPE(c.c_uint64, c.c_void_p, c.c_uint64, c.c_void_p)


class Core(c.Structure):
    """The first fields of simavr 1.6's ``avr_t`` on 64-bit Linux; their layout is checked for every core."""

    _fields_ = (
        ("mmcu", c.c_char_p),
        ("ioend", c.c_uint16),
        ("ramend", c.c_uint16),
        ("flashend", c.c_uint32),
        ("e2end", c.c_uint32),
        ("_a", c.c_uint8 * 36),
        ("codeend", c.c_uint32),
        ("state", c.c_int),
        ("frequency", c.c_uint32),
        ("vcc", c.c_uint32),
        ("avcc", c.c_uint32),
        ("aref", c.c_uint32),
        ("cycle", c.c_uint64),
        ("run_cycle_count", c.c_uint64),
        ("run_cycle_limit", c.c_uint64),
        ("_b", c.c_uint8 * 56),
        ("run", c.c_void_p),
        ("sleep", c.c_void_p),
        ("_c", c.c_uint8 * 28),
        ("pc", c.c_uint32),
        ("_d", c.c_uint8 * (11712 - 208)),
        ("flash", c.c_void_p),
        ("data", c.c_void_p),
    )


@dataclass(frozen=True)
class Libraries:
    """simavr and the C library, with the signatures of the functions that are used."""

    simavr: Any
    libc: Any


@cache
def load_libraries() -> Libraries:
    """Load simavr.

    Raises
    ------
    RigctlError
        not on Linux, or the package is not installed.
    """
    if sys.platform != "linux":
        raise RigctlError(
            "the emulated board runs on Linux only",
            value=sys.platform,
            hint="Use '--backend simulated' here; it needs no board either",
        )
    try:
        simavr = c.CDLL("libsimavr.so.2")
    except OSError:
        raise RigctlError(
            "the emulated board needs simavr, which is not installed", hint=f"Install it: {INSTALL}"
        ) from None
    libc = c.CDLL(ctypes.util.find_library("c") or "libc.so.6")
    core = c.POINTER(Core)
    simavr.avr_make_mcu_by_name.restype = core
    simavr.avr_make_mcu_by_name.argtypes = [c.c_char_p]
    for name in ("avr_init", "avr_reset", "avr_run", "avr_terminate"):
        getattr(simavr, name).argtypes = [core]
    simavr.avr_loadcode.argtypes = [core, c.c_char_p, c.c_uint32, c.c_uint32]
    simavr.avr_io_getirq.argtypes = [core, c.c_uint32, c.c_int]
    simavr.avr_io_getirq.restype = c.c_void_p
    simavr.avr_raise_irq.argtypes = [c.c_void_p, c.c_uint32]
    simavr.avr_raise_irq.restype = None
    simavr.avr_irq_register_notify.argtypes = [c.c_void_p, IrqCallback, c.c_void_p]
    simavr.avr_cycle_timer_register.argtypes = [core, c.c_uint64, TimerCallback, c.c_void_p]
    simavr.avr_ioctl.argtypes = [core, c.c_uint32, c.c_void_p]
    libc.lfind.argtypes = [c.c_void_p, c.c_void_p, c.POINTER(c.c_size_t), c.c_size_t, c.c_void_p]
    libc.lfind.restype = c.c_void_p
    return Libraries(simavr, libc)


def ioctl_code(text: str) -> int:
    """Return the integer of one of simavr's four-letter codes."""
    return int.from_bytes(text.encode("ascii"), "big")


def address_of(function: Any) -> int:
    """Return the address of a C function."""
    address = c.cast(function, c.c_void_p).value
    if address is None:
        raise RigctlError("simavr lacks a function that the emulated board needs", hint=INSTALL)
    return address
