"""One bench of several devices: the newest value of every channel, and one ending for all outputs.

In: the benches of the devices, each a `Backend` of its own. Out: one `Backend`, whose every sample is the
reading of one device with the newest values of the others beside it.

Threads: the runner's thread calls the methods here; each device is called by its `DeviceThread` and by no
other. What the devices have to say arrives in the `Inbox`, which its condition protects; calls go the
other way as futures and are waited for with a limit of wall time, so that a device that hangs delays the
others by no more than that. `Merging` is used by the runner's thread alone.

Every call from the runner also keeps the devices alive (`_called`): a thread leaves its device to the
guard, or to its watchdog, once the runner has not called for a second. See
docs/decisions/0181-several-devices-are-read-independently.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, wait
from datetime import datetime, timedelta
from functools import partial
from time import monotonic
from typing import Any

from rigctl.backends.combined.device_thread import DeviceThread, Inbox, lost
from rigctl.backends.combined.merging import Merging
from rigctl.backends.commands import check_command
from rigctl.backends.errors import BackendLost, BenchTripped, OutputsNotSafe
from rigctl.backends.protocol import Backend, CommandReceipt, Notice, PendingCommand, Regulator, Sample
from rigctl.clock import Clock
from rigctl.errors import RigctlError
from rigctl.plan.loop import LoopSettings, LoopState
from rigctl.rig import DEVICES, Rig

#: s of wall time for all devices together to become safe, and to be closed
_SAFE_WITHIN = 5.0
#: s of wall time for all devices together to be opened; a device that hangs must not hold the others
_OPEN_WITHIN = 60.0
#: s of wall time for a call that a device answers without being asked
_AT_ONCE = 1.0
#: s of wall time between two looks while something is opened: a signal is handled in between
_LOOK = 0.2


class CombinedBench:
    """A `Backend` of several devices, each with its own rate, clock and latency.

    Each device is used by a thread of its own alone. A sample is made of each reading of any device, with the
    newest values of the others; `Sample.reading` says which is new, and when it was taken.

    Parameters
    ----------
    rig: the whole bench.
    clock: real.
    benches: the bench of each device, by name, not yet open.
    addresses: of those devices that have one.
    """

    timed = True  #: a device that cannot time a pulse has it ended by its thread

    def __init__(
        self, rig: Rig, clock: Clock, benches: Mapping[str, Backend], addresses: Mapping[str, str]
    ) -> None:
        self.clock = clock
        self.devices = dict(benches)
        self._rig = rig
        self._addresses = addresses
        self._inbox = Inbox()
        self._merging = Merging(rig)
        self._threads: dict[str, DeviceThread] = {}
        self._regulating = ""  # the device of the newest loop
        self._announced: set[str] = set()  # lost devices whose notices could be fetched
        self._opened = 0.0  # s, when all devices were open

    @property
    def identity(self) -> Mapping[str, str]:
        """The kind and name of the bench, and the identity of each device: ``supply.kind``, …"""
        known = {"kind": DEVICES, "name": self._rig.name}
        for name, bench in self.devices.items():
            facts = {key: value for key, value in bench.identity.items() if key != "name"}
            if name in self._addresses:
                facts = {"port": self._addresses[name]} | facts
            known |= {f"{name}.{key}": value for key, value in facts.items()}
        return known

    @property
    def without_host(self) -> str:
        """What happens to the outputs of each device."""
        return "; ".join(f"{name}: {bench.without_host}" for name, bench in self._driving().items())

    @property
    def outputs_read(self) -> frozenset[str]:
        """Those of all devices."""
        return frozenset().union(*(bench.outputs_read for bench in self.devices.values()))

    @property
    def outputs_answered(self) -> frozenset[str]:
        """Those of all devices."""
        return frozenset().union(*(bench.outputs_answered for bench in self.devices.values()))

    # --- open and close -----------------------------------------------------------------------------------

    def open(self) -> None:
        """Open all devices at once; if any fails, the others are left, and safe, and the error names all."""
        self._called()
        self._threads = {name: DeviceThread(name, bench, self._inbox) for name, bench in self.devices.items()}
        # All at once, as opening takes about a second each, most of it waiting.
        opening = {name: thread.open() for name, thread in self._threads.items()}
        try:
            self._wait(opening.values(), _OPEN_WITHIN)
        except BaseException:
            self.close()
            raise
        # A device that did not answer counts like one that refused: a bench is open only with all of its
        # devices.
        errors = _errors(opening) | {
            name: BackendLost(f"not open within {_OPEN_WITHIN:g} s") for name in _unanswered(opening)
        }
        if errors:
            self.close()
            raise self._unopened(errors)
        self._opened = self.clock.now()

    def close(self) -> None:
        """Close all devices at once."""
        threads, self._threads = self._threads, {}
        self._called()
        self._wait([thread.close() for thread in threads.values()], _SAFE_WITHIN)

    # --- samples ------------------------------------------------------------------------------------------

    def start(self, rate: float) -> None:
        """Read each device at `rate` Hz, or as fast as it can be read if that is slower."""
        if not (math.isfinite(rate) and rate > 0.0):
            raise RigctlError("not a sampling rate", value=f"{rate:g} Hz", expected="e.g. '10 Hz'")
        self._check_open()
        self._merging.start(rate)

        def start(name: str, bench: Backend) -> Callable[[], None]:
            return lambda: bench.start(self._rig.rate_of(name, rate))

        # A device that was lost, and is allowed to be, is not asked: its thread reads no more.
        started = {
            name: thread.call(start(name, thread.bench))
            for name, thread in self._threads.items()
            if name not in self._inbox.lost
        }
        self._wait(started.values(), _AT_ONCE)  # a device that is busy starts later
        # Before the errors are looked at: one that answers in between is an error then, and not overlooked.
        late = _unanswered(started)
        errors = _errors(started)
        # The loss of a device that the run can do without shows as its silence, see `Sampling`; a rate that
        # it refuses is a mistake all the same.
        for name in [name for name in errors if not self._needs(name)]:
            error = errors[name]
            if isinstance(error, BackendLost):  # its silence is noticed
                del errors[name]
        if errors:
            raise _named(errors)
        for name in late:
            started[name].add_done_callback(partial(self._started_late, name))

    def next_sample(self, timeout: float) -> Sample | None:
        """Return the bench as of the next reading of any device."""
        self._check_open()
        give_up = monotonic() + timeout / self.clock.speed
        inbox = self._inbox
        # The lock is held while the inbox is looked at, and given up during the wait.
        with inbox.arrived:
            inbox.answered = False
            while not inbox.samples:
                left = give_up - monotonic()
                # Samples in hand come first, also those of a device that is lost since.
                if inbox.lost and self._lost():
                    return None
                if inbox.answered or left <= 0.0:
                    return None
                inbox.arrived.wait(left)
            device, sample = inbox.samples.popleft()
            switched, inbox.switched = inbox.switched, []
        # Switches before the sample: a command that was carried out before this reading is in force in its
        # row.
        for receipt in switched:
            self._merging.switched(receipt)
        return self._merging.sample(device, sample)

    def take_receipts(self) -> list[CommandReceipt]:
        """Return the ends of pulses, and switches made by the devices themselves."""
        if not self._inbox.receipts:  # looked at after each sample; what arrives now is taken after the next
            return []
        with self._inbox.arrived:
            taken, self._inbox.receipts = self._inbox.receipts, []
        return taken

    def take_notices(self) -> list[Notice]:
        """Return the notices of all devices, each with the name of its device."""
        if not self._inbox.notices:
            return []
        with self._inbox.arrived:
            taken, self._inbox.notices = self._inbox.notices, []
        return taken

    # --- commands -----------------------------------------------------------------------------------------

    def command(self, actuator: str, value: float, *, duration: float | None = None) -> PendingCommand:
        """Have the actuator's device send a command."""
        self._check_open()
        check_command(self._rig, actuator, value, duration)
        device = self._rig.device_of(actuator)
        if not device:  # the operator's
            receipt = CommandReceipt(self.clock.now(), actuator, value)
            self._merging.switched(receipt)
            return PendingCommand.answered(receipt)
        bench = self.devices[device]
        return self._send(actuator, value, lambda: bench.command(actuator, value, duration=duration))

    def safe(self) -> None:
        """Bring every output of every device to its safe state, all at once; one that is dead delays none."""
        self._check_open()
        # Started on all devices before any is waited for.
        making = {name: self._threads[name].safe() for name in self._driving()}
        self._wait(making.values(), _SAFE_WITHIN)
        # Silence is no confirmation. When such a device was last heard is reported with it.
        errors = _errors(making) | {
            name: OutputsNotSafe(f"no answer within {_SAFE_WITHIN:g} s", {}, self._last_read(name))
            for name in _unanswered(making)
        }
        self._take_switches()
        now = self.clock.now()
        # Those that have confirmed count as safe, although the bench as a whole does not.
        for output in (output for name in making.keys() - errors.keys() for output in self._outputs(name)):
            self._merging.switched(CommandReceipt(now, output, float(self._rig.safe_state.get(output, 0.0))))
        if errors:
            raise _doubts(errors, self._safe_besides(errors))

    # --- closed loops -------------------------------------------------------------------------------------

    def cannot_regulate(self, loop: LoopSettings) -> str:
        """Return why no device can run a loop by itself; empty if one can."""
        device = self._rig.device_of(loop.actuator)
        bench: object = self.devices.get(device)
        if not isinstance(bench, Regulator):
            return f"the device of {loop.actuator} has no controller of its own"
        if self._rig.device_of(loop.channel) != device:
            return f"{loop.channel} and {loop.actuator} belong to different devices"
        return bench.cannot_regulate(loop)

    def regulate(self, loop: LoopSettings) -> PendingCommand:
        """Start a loop on the device of its actuator."""
        self._regulating = self._rig.device_of(loop.actuator)
        bench = self._regulator()
        return self._send(loop.actuator, loop.low, lambda: bench.regulate(loop))

    def loop_state(self, ahead: float | None = None) -> LoopState:
        """Return the state of the newest loop."""
        if not self._regulating:
            return LoopState(False, None)
        self._check_open()
        bench, device = self._regulator(), self._regulating
        asked = self._threads[device].call(lambda: bench.loop_state(ahead))
        self._wait([asked], _AT_ONCE)
        if not asked.done():
            raise lost(device, f"no answer within {_AT_ONCE:g} s")
        return asked.result()

    def stop_regulating(self, actuator: str) -> PendingCommand:
        """End a loop, leaving its output unchanged."""
        bench = self._regulator()
        return self._send(actuator, 0.0, lambda: bench.stop_regulating(actuator))

    # --- internal -----------------------------------------------------------------------------------------

    def _regulator(self) -> Regulator:
        bench: object = self.devices.get(self._regulating)
        if not isinstance(bench, Regulator):
            raise RuntimeError("a bench without a controller was asked for a loop")
        return bench

    def _send(self, actuator: str, value: float, command: Callable[[], PendingCommand]) -> PendingCommand:
        self._check_open()
        pending = PendingCommand(actuator, value, self._let_pass)
        self._threads[self._rig.device_of(actuator)].send(command, pending)
        return pending

    def _take_switches(self) -> None:
        """Take note of what the devices have carried out, before what follows it."""
        with self._inbox.arrived:
            taken, self._inbox.switched = self._inbox.switched, []
        for receipt in taken:
            self._merging.switched(receipt)

    def _let_pass(self) -> None:
        """Let time pass until something has arrived."""
        self._called()
        with self._inbox.arrived:
            if not self._inbox.answered:
                self._inbox.arrived.wait(_LOOK)
            self._inbox.answered = False

    def _started_late(self, device: str, started: Future[None]) -> None:
        """A device that was busy has been asked to start: one that cannot is lost."""
        error = started.exception()
        if error is not None:
            with self._inbox.arrived:
                self._inbox.lost[device] = str(error) or repr(error)
                self._inbox.arrived.notify()

    def _last_read(self, device: str) -> datetime:
        """Return when a device was last heard: its newest reading, or when the bench was opened."""
        silence = self.clock.now() - self._merging.read_at.get(device, self._opened)
        return self.clock.date() - timedelta(seconds=silence)

    def _wait(self, futures: Iterable[Future[Any]], limit: float) -> None:
        """Wait for the results of devices, `limit` s of wall time at most; they are kept alive meanwhile."""
        give_up = monotonic() + limit
        while wait(futures, min(_LOOK, max(give_up - monotonic(), 0.0))).not_done:
            self._called()
            if monotonic() >= give_up:
                return

    def _unopened(self, errors: Mapping[str, BaseException]) -> BaseException:
        """Return the error for devices that could not be opened; the others have been made safe."""
        safe = self._safe_besides(errors) & (self.outputs_read | self.outputs_answered)
        error = _named(errors, safe)
        if isinstance(error, BackendLost) and safe:
            error.what += f"; confirmed safe: {', '.join(sorted(safe))}"
        return error

    def _lost(self) -> bool:
        """Return if a device is newly lost, whose notices are fetched first.

        Raises
        ------
        BackendLost
            the bench is lost with it, and its notices could be fetched.
        """
        needed = {name: why for name, why in self._inbox.lost.items() if self._needs(name)}
        if gone := needed.keys() - self._announced:
            self._announced |= gone
            return True
        for device, why in needed.items():
            raise lost(device, why)
        return self._given_up()

    def _given_up(self) -> bool:
        """Say once of each device that the bench does without that it is gone for good; return if any is.

        Another device may have answered in its place, or the time to look for it is over.
        """
        gone = self._inbox.lost.keys() - self._announced
        self._announced |= gone
        for device in sorted(gone):
            why = f"{device}: {self._inbox.lost[device]}; it is not taken up again in this run"
            fields = {"device": device, "warning": "device_gone"}
            self._inbox.notices.append(Notice(self.clock.now(), "fault", why, fields))
        return bool(gone)

    def _needs(self, device: str) -> bool:
        """Whether the bench is lost with this device."""
        return self._rig.devices[device].lost != "continue"

    def _called(self) -> None:
        self._inbox.called = monotonic()

    def _check_open(self) -> None:
        self._called()
        if not self._threads:
            raise BackendLost("the bench is not open")

    def _driving(self) -> dict[str, Backend]:
        """Return the devices with outputs."""
        return {name: bench for name, bench in self.devices.items() if self._outputs(name)}

    def _outputs(self, device: str) -> list[str]:
        actuators = self._rig.parts[device].actuators
        return [name for name, actuator in actuators.items() if actuator.by == "driven"]

    def _safe_besides(self, others: Iterable[str]) -> frozenset[str]:
        """Return the outputs of all devices except these."""
        devices = self.devices.keys() - set(others)
        return frozenset(name for device in devices for name in self._outputs(device))


def _errors(futures: Mapping[str, Future[Any]]) -> dict[str, BaseException]:
    """Return the errors of the devices that have answered."""
    return {
        name: error
        for name, future in futures.items()
        if future.done() and (error := future.exception()) is not None
    }


def _unanswered(futures: Mapping[str, Future[Any]]) -> list[str]:
    """Return the devices that have not answered yet."""
    return [name for name, future in futures.items() if not future.done()]


def _named(errors: Mapping[str, BaseException], safe: frozenset[str] = frozenset()) -> BaseException:
    """Return one error for those of several devices, which names them all.

    Its kind is the worst: outputs that may be on, then a device that is not reached, then a mistake, and a
    trip, which says that outputs are safe, only if there is nothing else. `safe` are outputs that are.
    """
    # From the worst to the mildest; see the order above.
    if any(isinstance(error, OutputsNotSafe) for error in errors.values()):
        return _doubts(errors, safe)
    texts = {name: f"{name}: {error}" for name, error in errors.items()}
    if any(isinstance(error, BackendLost) for error in errors.values()):
        return BackendLost("; ".join(texts.values()))
    name = next((name for name, error in errors.items() if not isinstance(error, BenchTripped)), min(errors))
    error = errors[name]
    if isinstance(error, RigctlError):
        others = [text for other, text in texts.items() if other != name]
        error.what = "; ".join([*others, f"{name}: {error.what}"])
    return error


def _doubts(errors: Mapping[str, BaseException], confirmed: frozenset[str]) -> OutputsNotSafe:
    """Return the error for devices whose outputs may not be safe, while those of the others are."""
    doubts = [error for error in errors.values() if isinstance(error, OutputsNotSafe)]
    outputs = {name: value for error in doubts for name, value in error.outputs.items()}
    seen = [error.unseen_since for error in doubts if error.unseen_since is not None]
    text = "; ".join(f"{name}: {error}" for name, error in errors.items())
    return OutputsNotSafe(text, outputs, min(seen, default=None), confirmed)
