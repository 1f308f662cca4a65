"""All outputs to the safe state, whichever program controls the bench: the function behind `rigctl off`.

In: a rig and how to reach its bench. Out: what was done, and whether every output is confirmed to be safe.

A bench can have been taken by a run, by a program that hangs, or by nobody, and `off` has to work for all
of them. The order is that of least risk: first the runs on this bench are asked to end, as they hold the
port and know what they have switched on; then, unless the run that has every address has confirmed that
all is safe, the lock is taken, whoever has it, and the bench is commanded from here. Time is bounded at
each point, since somebody is waiting for a heater to go off.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep

from rigctl.backends.errors import BackendLost, BenchTripped, OutputsNotSafe
from rigctl.backends.protocol import Backend, Sample
from rigctl.dataset.catalogue import run_folders
from rigctl.dataset.recording.writer_lock import read_state
from rigctl.dataset.run_json import read_info
from rigctl.errors import ExitCode, RigctlError
from rigctl.rig import DEVICES, Rig
from rigctl.runner.bench_access import UNREAL, Access, addresses_in, bench_lock, opened
from rigctl.runner.operators.remote_control import send
from rigctl.runner.operators.requests import Request
from rigctl.runner.rig_lock import owners

#: s of wall time for a run to answer, and again to report that its outputs are safe
_ANSWER = 0.8
_LOOK = 0.02
#: s for all runs together; after that only the one that has the bench is asked
_ALL_ANSWERS = 3.0
_ENDED = ("finished", "failed", "aborted")


@dataclass(frozen=True)
class SwitchedOff:
    """The result of `switch_off`.

    Parameters
    ----------
    done: one sentence.
    confirmed: whether every output was read back, or the bench has acknowledged its command, or the run in
        control of the bench has confirmed it.
    known_by: the source of the confirmation.
    ended: the runs that were ended, each with its answer.
    """

    done: str
    confirmed: bool
    known_by: str
    ended: tuple[str, ...] = ()


def switch_off(rig: Rig, how: Access) -> SwitchedOff:
    """Bring every output to the safe state, now, and read them back.

    Runs in progress on this bench, also simulated ones, are asked to end: they make outputs safe first. Any
    other program that has the bench, or does not answer, loses it.

    Raises
    ------
    RigctlError
        the bench cannot be reached, or its outputs differ from the commands.
    """
    # 1. Who has the bench: by its addresses, by its name, and by the heartbeats of the runs in this project.
    at_address, holders, same = _holders(rig, how) if how.exclusive else (None, [], True)
    folders = holders + [folder for folder in _in_progress(rig, how) if folder not in holders]
    ended, safe = [], set[Path]()
    give_up = monotonic() + _ALL_ANSWERS
    # 2. Each is asked to end. Those that hold the bench come first in the list, and are asked however long it
    #   takes.
    for folder in folders:
        if (
            folder not in holders and monotonic() > give_up
        ):  # many that do not answer must not delay the bench
            ended.append(f"{folder.name}: not asked")
            continue
        try:
            answer = send(folder, Request.ABORT, timeout=_ANSWER)
        except RigctlError as error:
            answer = error.what
        else:
            # Its answer says that it is ending; only its heartbeat says that the outputs are confirmed to be
            # safe.
            safe |= {folder} if folder in holders and _made_safe(folder) else set()
        ended.append(f"{folder.name}: {answer}")
    # 3. Nothing to command from here: a simulated bench ends with its process.
    if _unreal(rig, how):
        return _nothing_real(rig, how, folders, ended)
    by_run = SwitchedOff("; ".join(ended), True, "the run that has the bench has made it safe", tuple(ended))
    # 4. The run that has all addresses has confirmed: its word is as good as a reading from here, and
    #   earlier.
    if at_address in safe:
        return by_run
    try:
        # 5. Otherwise from here, with the lock taken from whoever has it.
        done, confirmed, known_by = _switch_off_here(rig, how)
    except RigctlError:
        # Not reachable at the address of the rig file, where a run uses another one: then its confirmation
        # counts.
        if same and holders and safe.issuperset(holders):  # it has another port than that of the rig file
            return by_run
        raise
    return SwitchedOff("; ".join([*ended, done]), confirmed, known_by, tuple(ended))


def _unreal(rig: Rig, how: Access) -> bool:
    """Whether the bench, or each of its devices, exists only in the process that uses it."""
    kind = how.backend or rig.kind
    return kind in UNREAL or (kind == DEVICES and all(part.kind in UNREAL for part in rig.parts.values()))


def _nothing_real(rig: Rig, how: Access, folders: list[Path], ended: list[str]) -> SwitchedOff:
    """A bench that exists only in the process that uses it: it ends together with that process."""
    with bench_lock(rig, "'rigctl off'", how, at_any_cost=True):
        pass  # a program that moves or monitors it by hand loses it
    if not all(_made_safe(folder) for folder in folders):
        known_by = "a run has not said that its outputs are safe"
        done = f"OUTPUTS NOT CONFIRMED SAFE ({known_by})"
        return SwitchedOff("; ".join([*ended, done]), False, known_by, tuple(ended))
    kind = how.backend or " and ".join(sorted({part.kind for part in rig.parts.values()}))
    known_by = f"a {kind} bench lives in the process that uses it: no real one was touched"
    done = f"outputs are safe: {_safe_state(rig)} ({known_by})"
    return SwitchedOff("; ".join([*ended, done]), True, known_by, tuple(ended))


def _safe_state(rig: Rig) -> str:
    """E.g. ``heater off, valve neutral``."""
    return ", ".join(f"{name} {rig.actuators[name].show(float(at))}" for name, at in rig.safe_state.items())


def _elsewhere(rig: Rig, how: Access) -> bool:
    """Whether the bench was named by another port than that of its rig file: runs on other ports continue."""
    port = how.options.get("port")
    if isinstance(port, Mapping):
        return any(address != rig.devices[name].port for name, address in port.items())
    return port is not None and port != rig.backend.port


def _holders(rig: Rig, how: Access) -> tuple[Path | None, list[Path], bool]:
    """The run that has every address of the bench; all runs that have one, or benches of its name unless
    another port was given; and whether each of these has this bench: one of another rig knows its outputs
    only, and its safe state."""
    try:
        at_addresses = bench_lock(rig, "", how).owners()
    except RigctlError:  # no port: a run was given one, and is found by the name of the bench
        at_addresses = []
    found = [owner for owner in at_addresses if owner is not None]
    if not _elsewhere(rig, how):
        found += owners(rig.name, how.lock_folder)
    runs = list(dict.fromkeys(Path(one.run) for one in found if one.run))
    whole = {owner.run if owner is not None else "" for owner in at_addresses}
    run = whole.pop() if len(whole) == 1 else ""
    return Path(run) if run else None, runs, all(owner.rig == rig.name for owner in found)


def _in_progress(rig: Rig, how: Access) -> list[Path]:
    """Runs in progress on a bench of this name, from this project."""
    addresses = addresses_in(rig, how) if _elsewhere(rig, how) else {}
    folders = []
    for folder in reversed(run_folders(how.runs)):
        state = read_state(folder)
        if state is None or not state.fresh or state.fields.get("state") in _ENDED:
            continue
        with suppress(RigctlError):
            info = read_info(folder)
            known = info.get("backend", {})
            ports = {name: known.get(f"{name}.port" if name else "port") for name in addresses}
            if info["rig"]["name"] != rig.name:
                continue
            if not addresses or any(
                not isinstance(port, str) or addresses[name].same_place(port) for name, port in ports.items()
            ):
                folders.append(folder)
    return folders


def _made_safe(folder: Path) -> bool:
    """Whether a run that was asked to end soon reports that its outputs are confirmed to be safe."""
    give_up = monotonic() + _ANSWER
    while monotonic() < give_up:
        state = read_state(folder)
        fields = state.fields if state is not None else {}
        if fields.get("state") in ("finishing", *_ENDED):
            return fields.get("unconfirmed", "") is None
        sleep(_LOOK)
    return False


def _switch_off_here(rig: Rig, how: Access) -> tuple[str, bool, str]:
    """Switch off; return a description, whether it is confirmed, and the source of the confirmation."""
    notices = ""
    confirmed, known_by = True, "the bench has answered each command"
    with bench_lock(rig, "'rigctl off'", how, at_any_cost=True):
        try:
            with opened(rig, how) as backend:
                # Opening has made outputs safe already, where it succeeded; this also raises what could not
                # be confirmed.
                backend.safe()
                read = _read_back(rig, backend)
                confirmed, known_by = _known_by(rig, read, backend.outputs_answered)
                notices = "".join(f"; {notice.message}" for notice in backend.take_notices())
        # A tripped board has switched off by itself, before it refused to be opened: this is the safe state.
        except BenchTripped as tripped:
            notices = f"; {tripped.what}; '--clear-trips' clears it once its cause is gone"
        except OutputsNotSafe as error:
            known_by = f"{error.what}; switch it off by hand, at its supply"
            done = f"OUTPUTS NOT CONFIRMED SAFE, commanded: {_safe_state(rig)} ({known_by})"
            return done, False, known_by
        except BackendLost as lost:
            raise BackendLost(
                lost.what,
                value=lost.value,
                hint="Switch the bench off by hand, at its supply; then look at the cable",
            ) from None
    outputs = "outputs are safe" if confirmed else "OUTPUTS NOT CONFIRMED SAFE, commanded"
    return f"{outputs}: {_safe_state(rig)}{notices} ({known_by})", confirmed, known_by


def _known_by(rig: Rig, read: frozenset[str], answered: frozenset[str]) -> tuple[bool, str]:
    """Whether every driven output is confirmed to be safe, and the source of the confirmation."""
    outputs = [name for name in rig.safe_state if rig.actuators[name].by == "driven"]
    unsure = [name for name in outputs if name not in read | answered]
    if unsure:
        return False, f"sent, not confirmed: {', '.join(unsure)}; see for yourself whether it is off"
    unread = [name for name in outputs if name not in read]
    if not unread:
        return True, "read back from the bench"
    if len(unread) == len(outputs):
        return True, "the bench has answered each command"
    return True, f"read back from the bench; {', '.join(unread)}: the bench has answered the command"


def _read_back(rig: Rig, backend: Backend) -> frozenset[str]:
    """Read the present outputs, as far as the bench reports them; none of a device that gave no sample.

    Raises
    ------
    RigctlError
        one differs from its safe value.
    """
    # Samples are what shows the outputs as they are, not as they were commanded.
    backend.start(rig.monitor_rate)
    read: set[str] = set()
    give_up = backend.clock.now() + min(1.0, 2.0 / rig.monitor_rate)
    while read < rig.parts.keys() and (left := give_up - backend.clock.now()) > 0.0:
        sample = backend.next_sample(left)
        if sample is not None:
            _require_safe(rig, sample)
            read.add(sample.device)
    return frozenset(name for name in backend.outputs_read if rig.device_of(name) in read)


def _require_safe(rig: Rig, sample: Sample) -> None:
    """Refuse a sample with an output that differs from its safe value."""
    for name, value in zip(rig.layout.commands, sample.commands, strict=True):
        safe = rig.safe_state.get(name)
        if safe is not None and rig.actuators[name].by == "driven" and value != float(safe):
            raise RigctlError(
                f"{name} is {rig.actuators[name].show(value)}, though it was commanded to be safe",
                hint="Switch the bench off by hand, at its supply",
                exit_code=ExitCode.FAILED,
            )
