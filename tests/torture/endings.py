"""Unplanned endings of runs at random moments: safe in time, no output on again, no data lost, and reported.

Each trial is a separate run in virtual time, in a separate process, so that a kill is a real kill. Outputs
are observed independently of rigctl: at the pins of the emulated chip, in the lines received by the stand-in
of the two-heater board, or at the plant's switch. The samples given to the run are compared with those on
the disk.
"""

from __future__ import annotations

import errno
import json
import math
import os
import random
import shutil
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from bench_stand import ScriptedClock, Stand
from rigctl.backends.emulated import create as emulated
from rigctl.backends.emulated.port import EmulatedPort
from rigctl.clock import VirtualClock
from rigctl.dataset import RunWriter, open_run, verify
from rigctl.dataset.recording import journal, log, writer
from rigctl.dataset.recording.disk_thread import BackgroundWriter
from rigctl.dataset.verification import Condition
from rigctl.plan.missing import MOST_MISSING, Lack
from rigctl.rig import Rig
from run_workshop import Workshop
from torture.unsteady import LooseContact, Restart

KINDS = ("simulated", "emulated", "lines")
#: s, the earliest and the latest moment of a disturbance
MOMENTS = {"simulated": (0.6, 4.4), "emulated": (0.6, 4.4), "lines": (0.6, 18.0)}
#: s from a signal to all outputs off. Virtual time has no slices in which to look: a signal is seen at the
#: next sample, which between two records is a tenth of a second away, on the two-heater board half a second.
SIGNAL_BOUND = {"simulated": 0.12, "emulated": 0.12, "lines": 0.6}
#: s from the last sign of life of the host to all outputs off, by the board's own watchdog
WATCHDOG_BOUND = 1.6
#: s of samples that an ending may cost
LOSS_BOUND = 1.0
#: s before the end of a run in which nothing is read back any more: a restart then is not noticed
_UNSEEN = 0.05
#: s of wall time after which a trial hangs
_HANGS = 300.0

_CYLINDER = """\
steps:
  - set: {heater: on}
  - repeat: 3
    do:
      - record: {name: stroke, rate: 100 HzRETRIES}
        do:
          - extend: {for: 0.6 s}
          - wait: 0.2 s
          - retract: {until: position < 1 mm, timeout: 3 s}
finally:
  - set: {heater: off, valve: neutral}
"""
_HEATERS = """\
steps:
  - set: {heater_1: 60 %}
  - repeat: 3
    do:
      - record: {name: heating, rate: 2 HzRETRIES}
        do:
          - wait: 3 s
          - set: {heater_2: 40 %}
          - wait: 3 s
          - set: {heater_2: 0 %}
finally:
  - set: {heater_1: 0 %, heater_2: 0 %}
"""


@dataclass(frozen=True)
class Disturbance:
    """Something that happens to a run.

    Parameters
    ----------
    what: its kind.
    begin, end: s of bench time; `end` of those that last.
    """

    what: str
    begin: float
    end: float = 0.0


@dataclass(frozen=True)
class Trial:
    """One run and what happens to it; all of it follows from the seed."""

    seed: str
    kind: str
    disturbances: tuple[Disturbance, ...]
    retries: bool

    @property
    def steps(self) -> str:
        text = _HEATERS if self.kind == "lines" else _CYLINDER
        return text.replace("RETRIES", ", retries: 2" if self.retries else "")

    def has(self, *kinds: str) -> bool:
        return any(one.what in kinds for one in self.disturbances)


_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
_LINE = ("loss", "mute", "noise")
_ENDING = {
    "simulated": (*_SIGNALS, "kill", "loss", "silent", "sensor", "full_disk"),
    "emulated": (*_SIGNALS, "kill", "stall", "loss", "noise", "reset", "hang", "sensor", "full_disk"),
    "lines": (*_SIGNALS, "kill", "stall", "loss", "mute", "noise", "reset", "full_disk"),
}
_BESIDE = {
    "simulated": (*_SIGNALS, "loss", "slow_disk", "full_disk"),
    "emulated": (*_SIGNALS, "loss", "noise", "slow_disk", "full_disk", "stall"),
    "lines": (*_SIGNALS, "loss", "mute", "noise", "slow_disk", "full_disk", "stall"),
}


def draw(seed: str, kind: str, beside: str = "") -> Trial:
    """A trial: one thing that may end the run, and often another one beside it, mostly soon after.

    With one of `unsteady.BESIDE`, that happens at some moment too.
    """
    rng = random.Random(seed)
    first, last = MOMENTS[kind]
    begin = rng.uniform(first, last)

    def make(what: str, begin: float) -> Disturbance:
        lasts = rng.choice((rng.uniform(0.01, 0.5), rng.uniform(0.5, 3.0), rng.uniform(3.0, 12.0), 1e6))
        if what == "stall":
            lasts = min(lasts, 12.0)
        return Disturbance(what, round(begin, 4), round(begin + lasts, 4))

    chosen = [make(rng.choice(_ENDING[kind]), begin)]
    if rng.random() < 0.5:
        begin = max(first, begin + rng.choice((rng.uniform(0.0, 0.3), rng.uniform(-2.0, 2.0))))
        # a disk's thread does not keep pace with virtual time, so that a kill would cost it more than it does
        others = [what for what in _BESIDE[kind] if chosen[0].what != "kill" or "disk" not in what]
        chosen.append(make(rng.choice(others), begin))
    retries = rng.random() < 0.5
    if beside:
        moment = random.Random(f"{seed} {beside}").uniform(first, last)
        chosen.append(Disturbance(beside, round(moment, 4), 1e6))
    return Trial(seed, kind, tuple(chosen), retries)


# --- the run, in a process of its own ---


class _Disturbed:
    """A trial's bench with everything that happens to it, and the witness's notes."""

    def __init__(self, trial: Trial, folder: Path, patch: pytest.MonkeyPatch) -> None:
        self.trial, self.folder, self.patch = trial, folder, patch
        self.stand = Stand(trial.kind, Workshop(folder), patch)
        self.clock: ScriptedClock = self.stand.clock
        self.rng = random.Random(f"{trial.seed} noise")
        self.given: list[float] = []  # time of each sample that the run was given
        self.facts: dict[str, Any] = {}
        self.loose = next(
            (
                LooseContact.drawn(trial.seed, trial.kind, one.begin)
                for one in trial.disturbances
                if one.what == "intermittent"
            ),
            None,
        )

    def carry_out(self) -> None:
        rig = self._rig()
        options = self._disturb()
        make = getattr(self.stand, f"_{self.trial.kind}")
        bench = make(rig, options)
        bench.open()
        self.facts["opened"] = self.clock.now()
        plan = self.stand.workshop.plan(self.trial.steps, rig)
        recorder = RunWriter.create(self.folder / "runs", self.stand.workshop.header(plan, bench))
        self._tap(bench, rig)
        kept = recorder if not self.trial.has("slow_disk", "full_disk") else BackgroundWriter(recorder)
        try:
            done = self.stand.workshop.run(self.trial.steps, rig=rig, backend=bench, writer=kept)
        finally:
            self.clock.actions.clear()
        self._outlive()
        result = done.result
        self.facts["result"] = {
            "status": result.status,
            "reason": result.reason,
            "exit_code": int(result.exit_code),
            "folder": str(result.folder),
            "duration": result.duration,
            "unconfirmed": result.unconfirmed,
        }
        self.note()

    def note(self) -> None:
        """Write down the outputs that were observed."""
        self.facts |= {"seen": self.stand.seen, "given": self.given}
        (self.folder / "witness.json").write_text(json.dumps(self.facts), encoding="utf-8")

    def _rig(self) -> Rig:
        changes = [("stale_after: 5 s", "stale_after: 2 s")] if self.trial.kind == "lines" else []
        rig = self.stand.rig(*changes)
        if self.loose is None:
            return rig
        self.facts["stops"] = self.loose.due(rig, self.trial.kind)
        return self.loose.rig(rig)

    def _tap(self, bench: Any, rig: Rig) -> None:
        if self.loose is not None:
            self.loose.wrap(bench, rig, self.facts.setdefault("impossible", []))
        next_sample = bench.next_sample

        def given(timeout: float) -> Any:
            sample = next_sample(timeout)
            if sample is not None:
                self.given.append(sample.time)
            return sample

        bench.next_sample = given

    def _disturb(self) -> dict[str, Any]:
        """Arrange all that happens; the options that the bench is made with."""
        # the file writer acts twice per second of wall time; here, twice per second of bench time
        self.patch.setattr(writer, "monotonic", self.clock.now)
        faults = [text for one in self.trial.disturbances for text in self._arrange(one)]
        return {"faults": faults} if faults else {}

    def _arrange(self, one: Disturbance) -> list[str]:
        """Arrange what happens to the host; a fault of the bench, where it is one."""
        match one.what:
            case "SIGINT" | "SIGTERM" | "SIGHUP":
                self.stand.signal_at(one.begin, number=getattr(signal, one.what))
            case "kill":
                self.clock.at(one.begin, self._kill)
            case "stall":
                self.clock.at(one.begin, lambda: VirtualClock.sleep_until(self.clock, one.end))
            case "slow_disk":
                self._slow_disk(one)
            case "full_disk":
                self._full_disk(one)
            case _:
                return self._arrange_bench(one)
        return []

    def _arrange_bench(self, one: Disturbance) -> list[str]:
        until = "" if one.end > 1e5 else f"..{one.end} s"
        match one.what:
            case "loss" | "mute" if self.trial.kind == "lines":
                name = "gone" if one.what == "loss" else "mute"
                self.clock.at(one.begin, lambda: setattr(self.stand.port, name, True))
                self.clock.at(one.end, lambda: setattr(self.stand.port, name, False))
            case "loss":
                return [f"backend_lost@{one.begin} s{until}"]
            case "silent":
                return [f"samples_stop@{one.begin} s{until}"]
            case "sensor":
                channel = self.rng.choice(("position", "oil_temperature", "supply_pressure"))
                fault = self.rng.choice(("sensor_open", "sensor_out_of_range"))
                return [f"{fault}:{channel}@{one.begin} s{until}"]
            case "reset":
                self.clock.at(one.begin, self._reset)
            case "restart" if self.trial.kind == "lines":
                restarted = self.facts.setdefault("restarted", []).append
                Restart.drawn(self.trial.seed, one.begin).arrange(self.stand, restarted)
            case "restart":
                self.clock.at(one.begin, self._reset)
            case "hang":
                self.clock.at(one.begin, self._hang)
            case "noise" if self.trial.kind == "lines":
                self._noise_on_lines(one)
            case "noise":
                self._noise_on_board(one)
        return []

    def _kill(self) -> None:
        """What the outputs do without a host is seen first: the witness dies with it."""
        self.facts["killed"] = self.clock.now()
        self._outlive()
        self.note()
        os.kill(os.getpid(), signal.SIGKILL)

    def _outlive(self) -> None:
        """Let the board run for another 3 s without a host."""
        if self.stand.board is not None:
            self.stand.board.run_to(self.stand.board.time + 3.0)

    def _reset(self) -> None:
        if self.stand.board is not None:
            self.stand.board.avr.reset()
        elif self.stand.port is not None:
            before = self.stand.port.sketch.heaters
            self.stand.port.sketch.reset()
            for name, value in zip(("heater_1", "heater_2"), before, strict=True):
                if value:
                    self.stand.seen.append((self.clock.now(), name, 0.0))

    def _hang(self) -> None:
        if self.stand.board is not None:
            self.stand.board.avr.send(b"\nDIAG:HANG\n")

    def _noise_on_lines(self, one: Disturbance) -> None:
        begin = one.begin
        while begin < min(one.end, one.begin + 12.0):
            self.clock.at(begin, self._spoil_line)
            begin += self.rng.uniform(0.05, 1.5)

    def _spoil_line(self) -> None:
        port = self.stand.port
        if port is None:
            return
        if not port._coming or self.rng.random() < 0.3:
            port.send_unasked(self.rng.randbytes(self.rng.randrange(1, 30)) + self.rng.choice((b"", b"\r\n")))
            return
        when, data = port._coming.pop()
        port._coming.append((when, _spoiled(data, self.rng)))

    def _noise_on_board(self, one: Disturbance) -> None:
        disturbed = self

        class Noisy(EmulatedPort):
            """A line on which bytes are lost, changed, cut and added."""

            def read(self, until: float) -> bytes:
                data = super().read(until)
                now = disturbed.clock.now()
                if data and one.begin <= now < one.end and disturbed.rng.random() < 0.2:
                    return _spoiled(data, disturbed.rng)
                return data

        self.patch.setattr(emulated, "EmulatedPort", Noisy)

    def _slow_disk(self, one: Disturbance) -> None:
        """The disk takes its time for each write while virtual time flies."""
        self._instead_of_writing(one, lambda: time.sleep(0.02))

    def _full_disk(self, one: Disturbance) -> None:
        def full() -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        self._instead_of_writing(one, full)

    def _instead_of_writing(self, one: Disturbance, action: Callable[[], None]) -> None:
        before = journal.write_fully

        def write(file: Any, part: Any) -> None:
            if one.begin <= self.clock.now() < one.end and "rescued" not in str(file.name):
                action()
            before(file, part)

        self.patch.setattr(journal, "write_fully", write)
        self.patch.setattr(log, "write_fully", write)


def _spoiled(data: bytes, rng: random.Random) -> bytes:
    """Some bytes of a line lost, changed or added."""
    at = rng.randrange(len(data))
    match rng.randrange(4):
        case 0:
            return data[:at]
        case 1:
            return data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :]
        case 2:
            return data[:at] + rng.randbytes(rng.randrange(1, 40)) + data[at:]
        case _:
            return data[:at] + data[at + rng.randrange(1, 6) :]


def _in_child(trial: Trial, folder: Path) -> None:
    """Carry out a trial and end the process, whatever happens."""
    code = 1
    try:
        os.environ["XDG_DATA_HOME"] = os.environ["TMPDIR"] = str(folder)
        for name in _SIGNALS:
            signal.signal(getattr(signal, name), signal.SIG_DFL)
        with pytest.MonkeyPatch.context() as patch:
            _Disturbed(trial, folder, patch).carry_out()
        code = 0
    except BaseException:  # noqa: BLE001 - the parent tells of it
        (folder / "problem.txt").write_text(traceback.format_exc(), encoding="utf-8")
    finally:
        os._exit(code)


def _process(trial: Trial, folder: Path) -> int:
    """The trial's wait status; a process that hangs is killed, and the trial fails."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of a fork beside the threads of a test runner
        child = os.fork()
    if child == 0:
        _in_child(trial, folder)
    give_up = time.monotonic() + _HANGS
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return status
        if time.monotonic() > give_up:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            raise AssertionError(f"hangs for {_HANGS:g} s")
        time.sleep(0.005)


# --- the judgement ---


@dataclass
class Tally:
    """What happened over all endings.

    Attributes
    ----------
    judged_in_time: endings whose moment was known and in which an output was on.
    slowest_off: s from an ending's cause to the last output off, by kind of bench.
    lost: s of samples, at most, in one ending.
    """

    endings: int = 0
    statuses: dict[str, int] = field(default_factory=dict)
    conditions: dict[str, int] = field(default_factory=dict)
    by_cause: dict[str, int] = field(default_factory=dict)
    judged_in_time: int = 0
    slowest_off: dict[str, float] = field(default_factory=dict)
    unconfirmed: int = 0
    rescued: int = 0
    lost: float = 0.0
    lost_in_all: float = 0.0
    failures: list[str] = field(default_factory=list)


def judge(trial: Trial, folder: Path, status: int, tally: Tally) -> None:
    """Check everything that must hold after an ending.

    Raises
    ------
    AssertionError
        something does not.
    """
    problem = folder / "problem.txt"
    assert not problem.exists(), problem.read_text(encoding="utf-8")
    facts = json.loads((folder / "witness.json").read_text(encoding="utf-8"))
    killed = facts.get("killed")
    assert (os.WIFSIGNALED(status)) is (killed is not None), (
        "only a kill ends a process without its last word"
    )
    result = facts.get("result")
    kept = Path(result["folder"]) if result is not None else next((folder / "runs").glob("2*"))
    ended = killed if killed is not None else result["duration"]
    _count(tally, trial, result, kept)
    _check_data(trial, kept, facts, ended, tally)
    _check_outputs(trial, facts, ended, kept, tally)
    if result is not None:
        _check_said(trial, result, kept, facts)


def _count(tally: Tally, trial: Trial, result: dict[str, Any] | None, kept: Path) -> None:
    tally.endings += 1
    said = "killed" if result is None else result["status"]
    tally.statuses[said] = tally.statuses.get(said, 0) + 1
    cause = f"{trial.kind} {trial.disturbances[0].what}"
    tally.by_cause[cause] = tally.by_cause.get(cause, 0) + 1
    tally.unconfirmed += bool(result and result["unconfirmed"])
    tally.rescued += "rescued" in str(kept)


def _check_data(trial: Trial, kept: Path, facts: dict[str, Any], ended: float, tally: Tally) -> None:
    verdict = verify(kept)
    tally.conditions[verdict.condition.value] = tally.conditions.get(verdict.condition.value, 0) + 1
    assert verdict.condition in (Condition.WHOLE, Condition.RECOVERED), verdict.problems
    assert verify(kept).condition is Condition.WHOLE
    run = open_run(kept)
    have = {round(float(time), 6) for time in run.table("samples")["time"].to_numpy()}
    given = facts["given"]
    missing = [time for time in given if round(time, 6) not in have]
    lost = _span(missing, given, ended)
    tally.lost = max(tally.lost, lost)
    tally.lost_in_all += lost
    bound = LOSS_BOUND if "killed" in facts else 0.6 if trial.kind == "lines" else 0.11
    assert lost <= bound, f"{lost:.3f} s of samples are lost: {missing[:3]}..{missing[-3:]} of {len(given)}"
    assert len(have) <= len(set(given)), "nothing is invented"
    if not trial.has(*_LINE, "silent", "hang", "reset", "restart", "stall", "sensor"):
        # the two-heater board is read twice a second, and the reading that an ending interrupts is not taken
        usual = 0.8 if trial.kind == "lines" else 0.12
        tail = ended - max(have, default=ended)
        assert tail <= usual + (LOSS_BOUND if "killed" in facts else 0.0), f"nothing of the last {tail:.3f} s"


def _span(missing: list[float], given: list[float], ended: float) -> float:
    """s that are covered by samples which are not on the disk."""
    lost = set(missing)
    span = 0.0
    for index, time_ in enumerate(given):
        if time_ in lost:
            later = given[index + 1] if index + 1 < len(given) else min(ended, time_)
            span += max(later - time_, 0.0)
    return span


def _check_outputs(trial: Trial, facts: dict[str, Any], ended: float, kept: Path, tally: Tally) -> None:
    seen = [tuple(entry) for entry in facts["seen"]]
    result = facts.get("result")
    levels = _levels(seen, math.inf)
    if trial.kind == "emulated" or result is not None:
        on = {name: value for name, value in levels.items() if value}
        said = bool(result and result["unconfirmed"])
        too_late = any(time > ended - _UNSEEN for time in facts.get("restarted", ()))
        assert not on or too_late or (said and trial.kind != "emulated"), (
            f"{on} at the end, and nothing is said"
        )
    first = _first_ending(kept)
    by_itself = set(facts.get("restarted", ()))
    if first is not None:
        again = [one for one in seen if one[0] > first + 0.001 and one[2] and one[0] not in by_itself]
        assert not again, f"on again after the ending at {first:g} s: {again}"
    for cause, due, until in _due(trial, facts):
        if cause > ended:
            continue
        tally.judged_in_time += any(_levels(seen, cause).values())
        on = {name: value for name, value in _levels(seen, cause + due).items() if value}
        assert not on, f"{due:g} s after {cause:g} s: {on}"
        again = [entry for entry in seen if cause + due < entry[0] < until and entry[2]]
        assert not again, f"on again after {cause:g} s: {again}"
        off = [at for at, _, value in seen if cause < at <= cause + due and not value]
        causes = {SIGNAL_BOUND[trial.kind]: "signal", WATCHDOG_BOUND: "watchdog"}
        kind = f"{trial.kind} {causes.get(due, 'limit')}"
        tally.slowest_off[kind] = round(
            max([tally.slowest_off.get(kind, 0.0), *(at - cause for at in off)]), 4
        )


def _levels(seen: list[tuple[float, str, float]], time: float) -> dict[str, float]:
    """The outputs at a time."""
    return {name: value for at, name, value in seen if at <= time}


def _first_ending(kept: Path) -> float | None:
    """The time at which the run logged that it began to make outputs safe, if it ended early."""
    for line in (kept / "log.jsonl").read_bytes().splitlines():
        try:
            event = json.loads(line)
        except ValueError:
            continue
        if event.get("kind") == "state" and event.get("state") in ("safe", "failed", "aborted", "finished"):
            return float(event["time"])
    return None


def _due(trial: Trial, facts: dict[str, Any]) -> list[tuple[float, float, float]]:
    """(moment, s until all is off, until when it stays so) of each disturbance that switches off for sure."""
    quiet = (*_LINE, "stall", "silent", "hang", "reset", "restart")
    line = [one for one in trial.disturbances if one.what in quiet]
    found = []
    if "stops" in facts and not line and facts.get("killed", math.inf) > sum(facts["stops"]):
        found.append((*facts["stops"], math.inf))
    for one in trial.disturbances:
        if one.begin < facts["opened"] + 0.3:
            continue  # the run had not begun
        killed_first = facts.get("killed", math.inf) < one.begin + SIGNAL_BOUND[trial.kind]
        if one.what in _SIGNALS and not line and not killed_first:
            found.append((one.begin, SIGNAL_BOUND[trial.kind], math.inf))
        elif trial.kind == "emulated" and (one.what in ("kill", "stall", "loss")):
            begin = _begun(one, trial)
            if one.what == "kill" or one.end - begin > WATCHDOG_BOUND:
                found.append((begin, WATCHDOG_BOUND, math.inf if one.what == "kill" else one.end))
    return found


def _begun(one: Disturbance, trial: Trial) -> float:
    """When it really began: a host that stands still already goes on for a moment before it does so again."""
    before = [other for other in trial.disturbances if other.what == one.what == "stall" and other is not one]
    return max([one.begin, *(other.end for other in before if other.begin <= one.begin < other.end)])


def _check_said(trial: Trial, result: dict[str, Any], kept: Path, facts: dict[str, Any]) -> None:
    """Status, exit code and reason agree with one another and with the disturbance."""
    status, code, reason = result["status"], result["exit_code"], result["reason"]
    info = json.loads((kept / "run.json").read_text(encoding="utf-8"))
    if not trial.has("full_disk"):
        assert (info["status"], info["reason"]) == (status, reason)
    pressed = [one for one in trial.disturbances if one.what in _SIGNALS and one.begin <= result["duration"]]
    if status == "finished":
        assert (code, reason) == (0, None)
        run = open_run(kept)
        assert list(run.records["outcome"]).count("complete") == 3
        stops = facts.get("stops")
        assert (
            stops is None or (*stops, math.inf) not in _due(trial, facts) or sum(stops) >= result["duration"]
        ), f"finished, though the limit exceeded at {stops} had to end it"
    elif status == "aborted":
        assert pressed, "nobody asked for the end"
        first = min(pressed, key=lambda one: one.begin)
        assert first.what in reason
        if not result["unconfirmed"] and not trial.has("full_disk"):
            assert code == (130 if first.what == "SIGINT" else 143)
    else:
        assert code == 1
        assert reason
        assert any(one.what not in (*_SIGNALS, "slow_disk") for one in trial.disturbances), reason
    if result["unconfirmed"]:
        assert code == 1
        assert "NOT CONFIRMED SAFE" in reason
    _check_commands(trial, result, kept, facts)
    _check_records(kept, facts)


def _check_records(kept: Path, facts: dict[str, Any]) -> None:
    """A record with too many impossible readings, or with a restart that was seen, is not complete."""
    records = open_run(kept).records
    for _, record in records[records["outcome"] == "complete"].iterrows():
        inside = [time for time in facts["given"] if record["start"] <= time <= record["end"]]
        impossible = [
            time for time in facts.get("impossible", ()) if record["start"] <= time <= record["end"]
        ]
        lack = Lack("readings", len(impossible), len(inside))
        assert not lack.exceeds(MOST_MISSING), f"complete, with {lack}"
        changed = [
            entry
            for entry in facts["seen"]
            if entry[0] in facts.get("restarted", ()) and record["start"] < entry[0] < record["end"]
        ]
        assert not changed, f"complete, with a restart in it: {changed}"


def _check_commands(trial: Trial, result: dict[str, Any], kept: Path, facts: dict[str, Any]) -> None:
    """A run that finished without interruption has logged the changes of its outputs."""
    lost = trial.has("loss", "mute", "noise", "reset", "restart", "stall", "silent", "intermittent")
    if result["status"] != "finished" or (lost and trial.retries):
        return
    lines = map(json.loads, (kept / "log.jsonl").read_text(encoding="utf-8").splitlines())
    commands = [event for event in lines if event["kind"] == "command"]
    for name in {name for _, name, _ in facts["seen"]}:
        logged = _steps([event["value"] for event in commands if event["actuator"] == name])
        really = _steps([value for _, which, value in facts["seen"] if which == name])
        assert logged == really, f"{name}: {logged} logged, {really} seen"


def _steps(values: list[float]) -> list[float]:
    """An output's changes, from off on."""
    values = [round(value, 6) for value in values]
    return [value for before, value in pairwise([0.0, *values]) if value != before]


def torture(
    folder: Path, trials: int, seed: int | str, kinds: Sequence[str] = KINDS, beside: str = ""
) -> Tally:
    """So many endings in turn on each kind of bench; those that broke a promise are `Tally.failures`.

    `beside`: one of `unsteady.BESIDE`, or nothing.
    """
    tally = Tally()
    for number in range(trials if kinds else 0):
        try:
            one(folder / "trial", f"{seed}-{number}", kinds[number % len(kinds)], tally, beside)
        except AssertionError as problem:
            tally.failures.append(str(problem))
    return tally


def one(folder: Path, seed: str, kind: str, tally: Tally, beside: str = "") -> None:
    """One ending.

    Raises
    ------
    AssertionError
        it broke a promise; names the trial, which can be repeated with its seed and kind.
    """
    trial = draw(seed, kind, beside)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    try:
        judge(trial, folder, _process(trial, folder), tally)
    except Exception as problem:
        raise AssertionError(f"{trial}: {problem}") from problem


def available() -> tuple[str, ...]:
    """The kinds of bench that can be tested here; none where a process cannot be forked."""
    if sys.platform == "win32":
        return ()
    return KINDS if sys.platform == "linux" else tuple(kind for kind in KINDS if kind != "emulated")
