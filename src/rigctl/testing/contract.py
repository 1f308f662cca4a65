"""The contract of every backend, as tests that pytest collects: rigctl's own backends pass the same.

A test file of a package with a backend has one class::

    from rigctl.testing.contract import BackendContract, Subject

    class TestMyBackend(BackendContract):
        def subject(self) -> Subject:
            rig = load_rig(Path("rig.yaml"))
            return Subject("mine", rig, lambda: create_backend(rig, "mine", real_clock()))

The rig needs a channel and a driven switch; a driven level is commanded too, if there is one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

from rigctl.backends.errors import BackendLost
from rigctl.backends.protocol import Backend, CommandReceipt, Sample
from rigctl.errors import RigctlError
from rigctl.rig import Rig

_RATE = 10.0  # Hz
_LATE = 0.2  # s by which samples may be late in virtual time
_PULSE = 0.3  # s
_MOST = 200  # calls within which something expected has to come


@dataclass
class Subject:
    """A backend under test, and what is known of its plant from elsewhere.

    Parameters
    ----------
    kind: what its identity says as ``kind``.
    rig: the bench.
    make: makes the backend, not yet open.
    outputs: returns the actual outputs, SI, by actuator; None where only the bench itself can report them.
    requests: returns how many requests the device has received; None where nobody counts them.
    real: whether it runs in real time, so that samples may be late on a busy computer.
    rest: s for which a switch has to stay off before it can be switched on again.
    """

    kind: str
    rig: Rig
    make: Callable[[], Backend]
    outputs: Callable[[], Mapping[str, float]] | None = None
    requests: Callable[[], int] | None = None
    real: bool = True
    rest: float = 0.0

    @property
    def off(self) -> bool:
        """Whether all outputs are in their safe state, as far as that is known from elsewhere."""
        if self.outputs is None:
            return True
        found = self.outputs()
        return all(
            found[name] == float(value) for name, value in self.rig.safe_state.items() if name in found
        )

    @property
    def switch(self) -> str:
        """The first driven switch."""
        return self._driven("switch")[0]

    @property
    def levels(self) -> list[str]:
        """The driven levels."""
        return self._driven("level")

    def _driven(self, kind: str) -> list[str]:
        return [name for name, one in self.rig.actuators.items() if (one.by, one.kind) == ("driven", kind)]


class BackendContract:
    """What every backend fulfils; a subclass says which one is tested."""

    def subject(self) -> Subject:
        """Return the backend under test."""
        raise NotImplementedError

    def test_it_can_be_used_only_while_it_is_open(self) -> None:
        """A bench that is not open is lost; closing it twice is harmless."""
        subject = self.subject()
        bench = subject.make()
        _refuses(BackendLost, lambda: bench.next_sample(0.0), "a sample before it was opened")
        bench.open()
        try:
            _holds(bench.identity["kind"] == subject.kind, "its identity has its kind", bench.identity)
            _holds(bool(bench.without_host), "it says what happens without its host")
            bench.start(_RATE)
            samples(bench, 1)
            bench.command(subject.switch, 1.0).wait()
        finally:
            bench.close()
        _holds(subject.off, "closing switches off")
        bench.close()
        _refuses(BackendLost, lambda: bench.next_sample(0.0), "a sample after it was closed")

    def test_it_refuses_what_cannot_be_before_anything_moves(self) -> None:
        """Wrong commands and rates are refused without any communication with the device."""
        subject = self.subject()
        wrong: list[tuple[str, float, float | None]] = [
            (f"{subject.switch}x", 1.0, None),
            (subject.switch, 0.5, None),
            (subject.switch, float("nan"), None),
            (subject.switch, 1.0, -1.0),
            *((level, 1e9, None) for level in subject.levels),
        ]
        with _opened(subject) as bench:
            before = subject.requests() if subject.requests is not None else 0
            for actuator, value, duration in wrong:
                command = partial(bench.command, actuator, value, duration=duration)
                _refuses(RigctlError, command, f"{actuator} = {value} for {duration} s")
            for rate in (0.0, float("nan")):
                _refuses(RigctlError, partial(bench.start, rate), f"a rate of {rate} Hz")
            _holds(subject.off, "what is refused moves nothing")
            if subject.requests is not None:
                _holds(subject.requests() == before, "what is refused is not sent")

    def test_samples_are_in_order_with_all_channels_and_commands(self) -> None:
        """Samples come at the rate, in order of time, with every channel and what is commanded."""
        subject = self.subject()
        with _opened(subject) as bench:
            bench.start(_RATE)
            found = samples(bench, 6)
            _holds(all(a.time < b.time for a, b in pairwise(found)), "samples are in order of time", found)
            lasted, expected = found[-1].time - found[0].time, 5.0 / _RATE
            on_time = abs(lasted - expected) <= _LATE or (subject.real and lasted > expected)
            _holds(on_time, f"six samples at {_RATE:g} Hz take {expected:g} s", lasted)
            for sample in found:
                _holds(len(sample.values) == len(subject.rig.layout.channels), "a value for each channel")
                possible = map(lambda c, v: c.possible(v), subject.rig.channels.values(), sample.values)
                _holds(all(possible), "values are in the range of their channels", sample)
                _holds(_commanded(subject, sample) == 0.0, "the switch is off at first", sample)

    def test_commands_are_confirmed_and_made_safe(self) -> None:
        """A receipt tells when a command was executed; samples show it; `safe` undoes it, repeatedly."""
        subject = self.subject()
        with _opened(subject) as bench:
            bench.start(_RATE)
            samples(bench, 1)
            before = bench.clock.now()
            receipt = bench.command(subject.switch, 1.0).wait()
            _holds((receipt.actuator, receipt.value) == (subject.switch, 1.0), "a receipt of it", receipt)
            after = bench.clock.now() + receipt.uncertainty
            _holds(before - receipt.uncertainty <= receipt.time <= after, "at its time", receipt)
            if subject.outputs is not None:
                _holds(subject.outputs()[subject.switch] == 1.0, "the output is on")
            _holds(_commanded(subject, samples(bench, 3)[-1]) == 1.0, "samples show the command")
            bench.safe()
            _holds(subject.off, "it is safe")
            bench.safe()
            _holds(_commanded(subject, samples(bench, 3)[-1]) == 0.0, "samples show that it is safe")

    def test_a_pulse_ends_by_itself(self) -> None:
        """A command with a duration is undone by the bench, which reports it."""
        subject = self.subject()
        with _opened(subject) as bench:
            bench.start(_RATE)
            samples(bench, 1)
            until = bench.clock.now() + subject.rest
            while bench.clock.now() < until:
                bench.next_sample(1.0)
            bench.command(subject.switch, 1.0, duration=_PULSE).wait()
            ended = _receipt(bench, subject.switch)
            _holds(ended.value == 0.0, "the pulse ends with the safe value", ended)
            _holds(subject.off, "the output is off after the pulse")


def samples(bench: Backend, count: int) -> list[Sample]:
    """Return so many samples; None in between is no sample.

    Raises
    ------
    AssertionError
        they do not come.
    """
    found: list[Sample] = []
    for _ in range(_MOST + count):
        sample = bench.next_sample(5.0)
        if sample is not None:
            found.append(sample)
        if len(found) == count:
            return found
    raise AssertionError(f"{len(found)} samples came instead of {count}")


@contextmanager
def _opened(subject: Subject) -> Iterator[Backend]:
    bench = subject.make()
    bench.open()
    try:
        yield bench
    finally:
        bench.close()


def _commanded(subject: Subject, sample: Sample) -> float:
    return sample.commands[subject.rig.layout.commands.index(subject.switch)]


def _receipt(bench: Backend, actuator: str) -> CommandReceipt:
    """Return the next switch of an actuator without a pending command."""
    for _ in range(_MOST):
        bench.next_sample(1.0)
        for receipt in bench.take_receipts():
            if receipt.actuator == actuator:
                return receipt
    raise AssertionError(f"no receipt of {actuator} came")


def _holds(condition: bool, what: str, found: object = None) -> None:
    if not condition:
        raise AssertionError(what if found is None else f"{what}: {found}")


def _refuses(error: type[Exception], action: Callable[[], object], what: str) -> None:
    try:
        action()
    except error:
        return
    raise AssertionError(f"not refused: {what}")
