"""A way to a bench: which backend, with which options, on which clock; its lock, and the open bench.

In: a rig, and what a command line says of its bench. Out: the lock of every address (`held`) and the open
backend (`opened`), each as a context manager that gives it back whatever happens. The lock comes first:
opening a port restarts many boards, which must not happen to a bench that another program is using.

Imports little: `rigctl off` must not wait for the modules that carry out a procedure.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from rigctl.backends.fine_timers import fine_timers
from rigctl.backends.protocol import Backend
from rigctl.backends.registry import addresses_with, create_backend
from rigctl.backends.transport.address import Address
from rigctl.clock import Clock, ScaledClock, VirtualClock, real_clock
from rigctl.errors import RigctlError, require_known
from rigctl.rig import DEVICES, Rig
from rigctl.runner.rig_lock import BenchLock, RigLock

#: backends that are not real benches and may run at any speed
UNREAL = ("simulated", "replay", "emulated")


@dataclass(frozen=True, kw_only=True)
class Access:
    """How a bench is reached.

    Parameters
    ----------
    runs: the folder that holds the runs.
    backend: name of the backend; the rig file's own when None.
    options: of the backend.
    clock: what the bench waits on.
    exclusive: whether others are excluded from commanding this bench; a private simulation needs no lock.
    lock_folder: folder of the locks; by default the user's state folder.
    """

    runs: Path
    backend: str | None = None
    options: Mapping[str, object] = field(default_factory=dict)
    clock: Clock = field(default_factory=real_clock)
    exclusive: bool = True
    lock_folder: Path | None = None


def clock_for(speed: str, backend: str) -> Clock:
    """The clock for ``max`` (virtual), ``1x`` (real) or ``10x``.

    Raises
    ------
    RigctlError
        the text has another form, or requests a real bench faster than real time.
    """
    try:
        factor = math.inf if speed == "max" else float(speed.removesuffix("x"))
    except ValueError:
        factor = math.nan
    if not (0.001 <= factor <= 1e6 or factor == math.inf):
        raise RigctlError("not a speed", value=speed, expected="max, 1x, or e.g. 10x")
    if backend not in UNREAL and factor != 1.0:
        raise RigctlError("a real bench knows one speed", value=speed, expected="1x")
    if math.isinf(factor):
        return VirtualClock(started=datetime.now(UTC))
    return ScaledClock(speed=factor)


def bench_options(
    backend: str,
    rig: Rig,
    *,
    port: str | Mapping[str, str] | Sequence[str] | None = None,
    seed: int | None = None,
    recording: str | None = None,
    runs: Path | None = None,
    clear_trips: bool = False,
) -> dict[str, object]:
    """The options of a backend from those of a command line.

    `port` may be a text or several: on a bench of several devices they have the form ``NAME=ADDRESS``.

    Raises
    ------
    RigctlError
        an option does not apply to this backend.
    """
    arguments: dict[str, object] = {
        "port": _port(backend, rig, port),
        "seed": seed,
        "run": recording,
        "clear_trips": clear_trips or None,
    }
    # An option that a backend would ignore is refused: whoever passes `--seed` to a real bench expects an
    # effect.
    accepted = {
        "simulated": ("seed",),
        "replay": ("run",),
        "serial": ("port", "clear_trips"),
        "modbus": ("port",),
        "visa": ("port",),
        "opcua": ("port",),
        "python": ("port",),
        DEVICES: ("port", "clear_trips"),
        "emulated": ("seed", "clear_trips"),
    }
    known = accepted.get(backend, tuple(arguments))
    for name, value in arguments.items():
        if value is not None and name not in known:
            what = "a run to play" if name == "run" else f"--{name.replace('_', '-')}"
            raise RigctlError(f"the {backend} backend takes no {what.removeprefix('a ')}", value=str(value))
    options = {name: arguments[name] for name in known if arguments.get(name) is not None}
    if backend in ("serial", "modbus", "visa"):
        options = {"port": rig.backend.port, "baud": rig.backend.baud} | options
    if backend == "replay" and runs is not None:
        options["runs"] = str(runs)
    return {name: value for name, value in options.items() if value is not None}


def _port(
    backend: str, rig: Rig, given: str | Mapping[str, str] | Sequence[str] | None
) -> str | dict[str, str] | None:
    """The port of a bench, or the addresses by device of one that has several."""
    if isinstance(given, Mapping):
        return dict(given)
    texts = [given] if isinstance(given, str) else list(given or ())
    if not texts:
        return None
    if backend != DEVICES or not rig.devices:  # the latter is refused when the bench is made
        if len(texts) > 1:
            raise RigctlError("the bench has one device", value=", ".join(texts), expected="one --port")
        return texts[0]
    addresses: dict[str, str] = {}
    for text in texts:
        name, equals, address = text.partition("=")
        if not (equals and address):
            first, *_ = rig.devices
            example = f"--port {first}={text}"
            raise RigctlError("which device is at this address?", value=text, expected=example)
        require_known("device", [name], rig.devices)
        if name in addresses:
            raise RigctlError(f"two addresses for '{name}'", value=text, expected="one")
        addresses[name] = address
    return addresses


@contextmanager
def opened(rig: Rig, how: Access) -> Iterator[Backend]:
    """The open bench; closed again whatever happens before, during or after the run."""
    backend = create_backend(rig, how.backend, how.clock, how.options)
    with fine_timers():
        try:
            backend.open()
            yield backend
        finally:
            # Also after a failed opening, which may have left a port, a guard or a thread behind.
            backend.close()


@contextmanager
def held(rig: Rig, purpose: str, how: Access) -> Iterator[BenchLock | None]:
    """The lock of the bench, if one is needed."""
    if not how.exclusive:
        yield None
        return
    with bench_lock(rig, purpose, how) as lock:
        yield lock


def bench_lock(rig: Rig, purpose: str, how: Access, *, at_any_cost: bool = False) -> BenchLock:
    """The lock of a bench, not yet taken: on each address, or on its name if it has none.

    Raises
    ------
    RigctlError
        an option is wrong, or no port is given.
    """
    keys = [address.key for address in addresses_in(rig, how).values()] or [""]
    return BenchLock(
        [RigLock(rig.name, purpose, how.lock_folder, key=key, at_any_cost=at_any_cost) for key in keys]
    )


def addresses_in(rig: Rig, how: Access) -> Mapping[str, Address]:
    """The addresses of a real bench, by device; none if it exists only in this process.

    Raises
    ------
    RigctlError
        as `bench_lock`.
    """
    return addresses_with(rig, how.backend, how.options)
