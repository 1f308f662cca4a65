"""An ATmega328P emulated by simavr: runs a program, with access to its serial bytes and pins.

In: the image of the firmware, bytes for its receiver, voltages at its inputs. Out: bytes from its
transmitter, and a call for each change of a pin, with the exact cycle. simavr is a C library without a
stable interface: the layout of its structures is checked at the start (`_check_layout`), since another
version would not fail but overwrite memory.

The inner loop is in C: ``lfind(key, base, &n, 0, f)`` calls ``f(key, base)`` until it returns 0, and
``avr_run(avr)`` returns the core's state, which is 0 only in `LIMBO`. A cycle timer sets that state at the
requested cycle, so that one call runs a whole slice. One call per instruction would be ten times slower.
"""

from __future__ import annotations

import ctypes as c
from collections.abc import Callable
from typing import Any

from rigctl.backends.emulated.library import (
    CRASHED,
    DONE,
    LIMBO,
    RUNNING,
    STOPPED,
    Core,
    IrqCallback,
    TimerCallback,
    address_of,
    ioctl_code,
    load_libraries,
)
from rigctl.errors import ExitCode, RigctlError

FREQUENCY = 16_000_000  #: Hz, the Uno's crystal
SUPPLY_MV = 5000
_SLICE_CYCLES = 2000  # simavr checks its timers at least this often
_BITS = 11  # per character: simavr 1.6 always counts a parity bit; with 10 its receiver overflows

# registers of the ATmega328P in data space
_UCSR0A, _UBRR0L, _UBRR0H = 0xC0, 0xC4, 0xC5
_TCCR1A, _OCR1AL, _OCR1AH = 0x80, 0x88, 0x89


class Avr:
    """One microcontroller.

    Parameters
    ----------
    program: the flash from address 0.
    pin_changed: called with (port letter, bit, level, cycle) when an output pin changes.
    """

    def __init__(self, program: bytes, pin_changed: Callable[[str, int, bool, int], None]) -> None:
        libraries = load_libraries()
        self._sim, self._libc = libraries.simavr, libraries.libc
        self._core = self._sim.avr_make_mcu_by_name(b"atmega328p")
        if not self._core:
            raise RigctlError("this simavr does not know the ATmega328P")
        self._state: Core = self._core.contents
        self._sim.avr_init(self._core)
        self._check_layout()
        self._state.frequency = FREQUENCY
        self._state.vcc = self._state.avcc = self._state.aref = SUPPLY_MV
        # by default simavr sleeps in real time; this function of simavr only adds up the time
        self._state.sleep = address_of(self._sim.avr_pending_sleep_usec)
        self._sim.avr_loadcode(self._core, program, len(program), 0)
        self._state.codeend = len(program)
        flags = c.c_uint32(0)  # no echo on stdout, no pause while the program polls
        self._sim.avr_ioctl(self._core, ioctl_code("uas0"), c.byref(flags))
        self._callbacks: list[Any] = []  # referenced by C, so must not be garbage-collected
        self._sent = bytearray()
        self._arriving = bytearray()
        self._receiving = False
        self._listen("uar0", 1, lambda value: self._sent.append(value & 0xFF))
        for port in "BD":
            for bit in range(8):
                self._listen(f"iog{port}", bit, self._watcher(port, bit, pin_changed))
        self._uart_in = self._irq("uar0", 0)
        self._adc = [self._irq("adc ", channel) for channel in range(6)]
        self._run = address_of(self._sim.avr_run)
        self._stopper = TimerCallback(self._stop)
        self._receiver = TimerCallback(self._receive)
        self._held = RUNNING
        self.resets = 0  #: number of restarts, by the watchdog or from outside

    @property
    def cycle(self) -> int:
        """Cycles since power-on."""
        return int(self._state.cycle)

    def close(self) -> None:
        """Free its memory."""
        if self._core is not None:
            self._sim.avr_terminate(self._core)
            self._core = None

    def run_to(self, cycle: int) -> None:
        """Run until `cycle`.

        Raises
        ------
        RigctlError
            the program crashed.
        """
        state, count = self._state, c.c_size_t(0)
        # Bytes handed over by another thread begin to arrive here, on the thread that runs the program.
        if self._arriving and not self._receiving:
            self._receiving = True
            self._sim.avr_cycle_timer_register(self._core, self._character, self._receiver, None)
        # Again, where a reset of the chip has cleared the timer that ends the slice.
        while state.cycle < cycle:
            if state.state in (DONE, CRASHED, STOPPED):
                raise RigctlError(
                    "the emulated board's program crashed",
                    value=f"address {state.pc:#x}",
                    exit_code=ExitCode.FAILED,
                )
            state.run_cycle_limit = _SLICE_CYCLES
            left = cycle - state.cycle
            self._sim.avr_cycle_timer_register(self._core, left, self._stopper, None)
            # limits the calls, since a reset clears all cycle timers; each call advances at least one cycle
            count.value = left + 1
            self._libc.lfind(self._core, self._core, c.byref(count), 0, self._run)
            if state.state == LIMBO:
                state.state = self._held
            elif state.run_cycle_limit == 1:  # set only by a reset
                self._restarted()

    def reset(self) -> None:
        """Reset the microcontroller, as its reset button does."""
        self._sim.avr_reset(self._core)
        self._restarted()

    def send(self, data: bytes) -> None:
        """Send bytes to its receiver, where they arrive one per character time, as on a wire.

        May be called from a thread other than the one that runs the program: no timer of simavr is registered
        here, since that could make its linked list of timers circular while the program is running.
        """
        self._arriving += data

    def take(self) -> bytes:
        """Return the bytes that the program has sent since the last call."""
        sent = bytes(self._sent)
        self._sent.clear()
        return sent

    @property
    def baud(self) -> float:
        """Baud rate set by the program, bits per second."""
        return FREQUENCY * _BITS / self._character

    def put_voltage(self, channel: int, millivolt: int) -> None:
        """Set an analog input to a voltage, 0 to 5000 mV."""
        self._sim.avr_raise_irq(self._adc[channel], min(max(millivolt, 0), SUPPLY_MV))

    @property
    def pwm(self) -> float:
        """Duty cycle of OC1A, 0 to 1."""
        if not self._register(_TCCR1A) & 0x80:
            return 0.0
        return (self._register(_OCR1AL) | self._register(_OCR1AH) << 8) / 1023

    def on_pwm(self, changed: Callable[[int], None]) -> None:
        """Call `changed` with the cycle of every later write to OC1A's compare register."""
        self._listen("tmr1", 0, lambda _: changed(self.cycle))

    @property
    def _character(self) -> int:
        divisor = (self._register(_UBRR0L) | self._register(_UBRR0H) << 8) + 1
        return int(_BITS * divisor * (8 if self._register(_UCSR0A) & 2 else 16))

    def _register(self, address: int) -> int:
        return int(c.cast(self._state.data, c.POINTER(c.c_uint8))[address])

    def _irq(self, kind: str, index: int) -> int:
        irq = self._sim.avr_io_getirq(self._core, ioctl_code(kind), index)
        if not irq:
            raise RigctlError("this simavr lacks a part of the ATmega328P", value=f"{kind}{index}")
        return int(irq)

    def _listen(self, kind: str, index: int, changed: Callable[[int], None]) -> None:
        callback = IrqCallback(lambda _irq, value, _parameter: changed(value))
        self._callbacks.append(callback)
        self._sim.avr_irq_register_notify(self._irq(kind, index), callback, None)

    def _watcher(
        self, port: str, bit: int, changed: Callable[[str, int, bool, int], None]
    ) -> Callable[[int], None]:
        return lambda value: changed(port, bit, bool(value), int(self._state.cycle))

    def _stop(self, _core: Any, _when: int, _parameter: Any) -> int:
        self._held = self._state.state
        self._state.state = LIMBO
        return 0

    def _receive(self, _core: Any, when: int, _parameter: Any) -> int:
        if not self._arriving:
            self._receiving = False
            return 0
        self._sim.avr_raise_irq(self._uart_in, self._arriving.pop(0))
        return when + self._character

    def _restarted(self) -> None:
        self.resets += 1
        self._receiving = False
        self._arriving.clear()

    def _check_layout(self) -> None:
        state = self._state
        fits = (
            state.mmcu.startswith(b"atmega328")
            and (state.ramend, state.flashend) == (0x8FF, 0x7FFF)
            and (state.frequency, state.run_cycle_limit) == (1_000_000, 1)
            and state.run == address_of(self._sim.avr_callback_run_raw)
            and state.sleep == address_of(self._sim.avr_callback_sleep_raw)
        )
        if not fits:
            raise RigctlError(
                "this simavr is laid out otherwise than version 1.6 on 64-bit Linux",
                hint="The emulated board cannot use it; '--backend simulated' needs none",
            )
