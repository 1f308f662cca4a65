"""rigctl and its guards as real processes on three devices of three protocols, one of them dead or strange.

The outputs of the one simulated plant behind the three servers are the witness. The times measured here
depend on how busy the computer is.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from protocol_servers import Server
from rigctl.dataset import verify
from rigctl.files.shipped import shipped
from several_devices import SeveralDevices, patient_devices, served_devices
from systems import own_state

ENDLESS = """\
procedure: endless
rig: rig.yaml
steps:
  - set: {heater: on, cooler: on, relief_valve: 30 bar}
  - record: {name: warm, rate: 10 Hz}
    do:
      - wait: 1 h
"""
#: what is wrong with one of the devices, and how the run ends, if not by that alone
FAULTS = ("none", "dead", "hung", "slow", "exchanged")
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
ENDINGS = ("by itself", *SIGNALS, "host killed", "host stands still", "guards killed")
#: the output of each device
OUTPUTS = {"controller": "heater", "plant": "relief_valve", "meter": "cooler"}
#: s after which a silent device is lost, and after which a guard acts; s for which the host stands still
_STALE, _WATCHDOG, _STANDS_STILL = 8.0, 8.0, 12.0
#: s from what ends a run to the outputs of sound devices off, on a very busy computer; the tally has times
_OFF_WITHIN = 30.0
#: s after which a device that is back has been switched off by its guard, which looks for it again and again
_FOUND_AGAIN = 90.0


@dataclass
class Tally:
    """What happened over all endings of several devices; times are s."""

    endings: int = 0
    not_begun: int = 0  # the computer was too busy for the devices to be opened
    statuses: dict[str, int] = field(default_factory=dict)
    slowest_off: dict[str, float] = field(default_factory=dict)
    left_on_and_said: int = 0
    off_once_back: int = 0
    failures: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Trial:
    """One run, the device with a fault, and its ending; `before` [s] is from the one to the other."""

    seed: str
    device: str
    fault: str
    ending: str
    before: float

    @property
    def told(self) -> bool:
        """Whether rigctl lives to say what it could not confirm."""
        return self.ending != "host killed"


def draw(seed: str) -> Trial:
    """A trial; something ends each run."""
    rng = random.Random(seed)
    fault = rng.choice(FAULTS)
    lost = fault in ("dead", "hung", "exchanged")
    ending = rng.choice(ENDINGS if lost else ENDINGS[1:])
    return Trial(seed, rng.choice(tuple(OUTPUTS)), fault, ending, rng.choice((0.0, rng.uniform(0.0, 1.5))))


def torture(folder: Path, trials: int, seed: int | str) -> Tally:
    """So many endings; those that broke a promise are `Tally.failures`."""
    tally = Tally()
    if not trials:
        return tally
    with served_devices() as devices:
        for number in range(trials):
            try:
                one(folder / f"trial-{number}", draw(f"{seed}-{number}"), devices, tally)
            except AssertionError as problem:
                tally.failures.append(str(problem))
    return tally


def one(folder: Path, trial: Trial, devices: SeveralDevices, tally: Tally) -> None:
    """One run, and how it ends.

    Raises
    ------
    AssertionError
        an output of a sound device stays on or comes on again, one of the other is on without a word, or a
        stranger was sent a command.
    """
    project = _project(folder)
    try:
        _carry_out(project, trial, devices, tally)
    except Exception as problem:
        raise AssertionError(f"{trial}: {problem}") from problem
    finally:
        _sound(devices.servers[trial.device])
        _wait_for(lambda: devices.circuit.off, "the outputs of the trial before")


def _project(folder: Path) -> Path:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / "rigctl.toml").write_text("", encoding="utf-8")
    (folder / "endless.yaml").write_text(ENDLESS, encoding="utf-8")
    text = shipped("rigs", "oil-circuit-devices.yaml").read_text(encoding="utf-8")
    # answers may be late on a busy computer
    text = patient_devices(text, f"{_STALE:g} s")
    text = text.replace("watchdog: 30 s", f"watchdog: {_WATCHDOG:g} s")
    (folder / "rig.yaml").write_text(text, encoding="utf-8")
    return folder


def _carry_out(project: Path, trial: Trial, devices: SeveralDevices, tally: Tally) -> None:
    circuit, server = devices.circuit, devices.servers[trial.device]
    circuit.switched.clear()
    host = subprocess.Popen(
        [sys.executable, "-m", "rigctl", "run", "endless.yaml", *devices.options, "--json"],
        cwd=project,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **own_state(project / "state")},
    )
    guards: list[int] = []
    try:
        _wait_for(lambda: all(circuit.outputs.values()) or host.poll() is not None, "the outputs on", 180.0)
        if host.poll() is not None:
            tally.not_begun += 1
            return
        time.sleep(random.Random(trial.seed).uniform(0.0, 1.0))
        guards = guards_of(host.pid)
        _disturb(server, trial.fault)
        time.sleep(trial.before)
        began = time.monotonic()
        _end(host, guards, trial)
        out, err = host.communicate(timeout=180.0)
        left = {name for name, value in circuit.outputs.items() if value}
        assert "Traceback" not in err, err
        said = json.loads(out) if out.strip() else {"status": "killed", "unconfirmed": None}
        _judge_sound(trial, circuit.switched, circuit.outputs, began, tally)
        _judge_said(trial, said, left, tally)
        _judge_strange(trial, server, guards, circuit.outputs, tally)
    finally:
        host.kill()
        host.communicate()
        for guard in guards:
            _wait_for(lambda guard=guard: not Path(f"/proc/{guard}").exists(), "a guard to end")
    (run,) = (project / "runs").glob("2*")
    assert verify(run).good


def guards_of(host: int) -> list[int]:
    """The process ids of its guards."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            parent = int((entry / "stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()[1])
            if parent == host and b"rigctl.backends.transport.guard" in (entry / "cmdline").read_bytes():
                found.append(int(entry.name))
    return found


def _disturb(server: Server, fault: str) -> None:
    match fault:
        case "dead":
            server.stop()
        case "hung":
            server.mute = True
        case "slow":
            server.delay = 2.0
        case "exchanged":  # the plug is pulled, and another device is there
            server.stop()
            server.exchanged = True
            server.start()


def _sound(server: Server) -> None:
    """The device as it was, and reachable."""
    server.mute, server.delay = False, 0.0
    server.stop()
    server.exchanged = False
    server.to_stranger.clear()
    server.start()


def _end(host: subprocess.Popen[str], guards: list[int], trial: Trial) -> None:
    match trial.ending:
        case "by itself":
            pass
        case "host killed":
            host.kill()
        case "host stands still":
            host.send_signal(signal.SIGSTOP)
            time.sleep(_STANDS_STILL)
            host.send_signal(signal.SIGCONT)
        case "guards killed":
            for guard in guards:
                os.kill(guard, signal.SIGKILL)
        case _:
            host.send_signal(getattr(signal, trial.ending))


def _judge_sound(
    trial: Trial,
    switched: list[tuple[float, str, float]],
    outputs: dict[str, float],
    began: float,
    tally: Tally,
) -> None:
    """Each output of a sound device is off in time, and is not switched on again."""
    sound = [name for device, name in OUTPUTS.items() if device != trial.device or trial.fault == "none"]
    _wait_for(lambda: not any(outputs[name] for name in sound), "outputs of sound devices off")
    time.sleep(0.5)
    cause = trial.ending if trial.ending != "by itself" else trial.fault
    for name in sound:
        after = [
            (at - began, value)
            for at, which, value in switched
            if which == name and at > began - trial.before
        ]
        assert [value for _, value in after] == [0.0], f"{name}: off once, and not on again: {after}"
        took = after[0][0]
        tally.slowest_off[cause] = round(max(took, tally.slowest_off.get(cause, 0.0)), 3)
        assert took <= _OFF_WITHIN, f"{name} off after {took:.2f} s"


def _judge_said(trial: Trial, said: dict[str, Any], left: set[str], tally: Tally) -> None:
    """What rigctl has not switched off when it ends it names, with its device."""
    tally.endings += 1
    tally.statuses[said["status"]] = tally.statuses.get(said["status"], 0) + 1
    if not trial.told:
        return
    assert said["status"] in ("aborted", "failed"), said
    for device, name in OUTPUTS.items():
        if name in left:
            named = said["unconfirmed"] or ""
            assert f"{device}: {name}" in named, f"{name} is on, and what is said is: {said}"
            tally.left_on_and_said += 1


def _judge_strange(
    trial: Trial, server: Server, guards: list[int], outputs: dict[str, float], tally: Tally
) -> None:
    """A stranger is sent nothing; a device that comes back is switched off by its guard, if that lives."""
    assert not server.to_stranger, f"sent to a stranger: {server.to_stranger}"
    name = OUTPUTS[trial.device]
    on = bool(outputs[name])
    _sound(server)
    if trial.ending == "guards killed":
        server.circuit.set(name, 0.0)  # by hand, as the run has said
        return
    _wait_for(lambda: not outputs[name], f"{name} off once its device is back", _FOUND_AGAIN)
    tally.off_once_back += on


def _wait_for(condition: Callable[[], object], what: str, patience: float = 60.0) -> None:
    give_up = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < give_up, f"waited in vain for {what}"
        time.sleep(0.01)
