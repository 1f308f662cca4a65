"""`rigctl off` decided step by step, in virtual time: who is asked, what is confirmed, and by whom."""

from __future__ import annotations

import json
import os
import time as wall
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from dataset.strokes import LAYOUT, STARTED
from rigctl.backends.errors import BackendLost, BenchTripped, OutputsNotSafe
from rigctl.backends.protocol import Notice, Reading, Sample
from rigctl.dataset import RunHeader, Source
from rigctl.dataset.run_json import write_info
from rigctl.errors import ExitCode, RigctlError
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, parse_rig
from rigctl.runner import switch_off as off
from rigctl.runner.bench_access import Access, addresses_in
from rigctl.runner.operators.requests import Request
from rigctl.runner.rig_lock import RigLock
from rigctl.testing import ScriptedClock

TCLAB = shipped("rigs", "tclab-board.yaml").read_text(encoding="utf-8")
PORT = "socket://10.0.0.9:5000"
BY_RUN = "the run that has the bench has made it safe"
SAFE = "outputs are safe: heater_1 0 %, heater_2 0 %"
UNSAFE = "OUTPUTS NOT CONFIRMED SAFE, commanded: heater_1 0 %, heater_2 0 %"


class Bench:
    """What the bench answers, as far as `rigctl off` asks it."""

    def __init__(self, rig: Rig) -> None:
        self.rig, self.clock = rig, ScriptedClock()
        self.outputs_read = self.outputs_answered = frozenset(rig.safe_state)
        self.silent: set[str] = set()
        self.commands = dict.fromkeys(rig.layout.commands, 0.0)
        self.rates: list[float] = []
        self.samples = self.opened = self.made_safe = 0
        self.trouble: RigctlError | None = None
        self.notices: list[Notice] = []

    def start(self, rate: float) -> None:
        self.rates.append(rate)

    def next_sample(self, timeout: float) -> Sample | None:
        assert self.rates, "no samples before they were asked for"
        self.samples += 1
        parts = list(self.rig.parts)
        name = parts[(self.samples - 1) % len(parts)]
        if name in self.silent:
            self.clock.sleep_until(self.clock.now() + min(timeout, 0.05))
            return None
        values = (0.0,) * len(self.rig.layout.channels)
        reading = Reading(name, self.clock.now(), values, ()) if self.rig.devices else None
        return Sample(self.clock.now(), values, tuple(self.commands.values()), reading)

    def safe(self) -> None:
        self.made_safe += 1
        if self.trouble is not None:
            raise self.trouble

    def take_notices(self) -> list[Notice]:
        return self.notices


@dataclass
class Scene:
    """A bench, its locks, and runs with their heartbeats."""

    folder: Path
    rig: Rig
    options: dict[str, object] = field(default_factory=lambda: {"port": PORT})
    now: float = 100.0  #: s of wall time
    asked: list[str] = field(default_factory=list)
    answers: dict[str, str] = field(default_factory=dict)
    later: list[tuple[float, Callable[[], object]]] = field(default_factory=list)
    unreachable: RigctlError | None = None
    backend: str | None = None
    exclusive: bool = True

    def __post_init__(self) -> None:
        self.bench = Bench(self.rig)

    @property
    def how(self) -> Access:
        return Access(
            runs=self.folder / "runs",
            backend=self.backend,
            options=self.options,
            lock_folder=self.folder / "locks",
            exclusive=self.exclusive,
        )

    def off(self) -> off.SwitchedOff:
        return off.switch_off(self.rig, self.how)

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        for entry in [one for one in self.later if one[0] <= self.now]:
            self.later.remove(entry)
            entry[1]()

    def send(self, folder: Path, request: Request, *, timeout: float) -> str:
        assert request is Request.ABORT
        self.asked.append(folder.name)
        if folder.name not in self.answers:
            self.sleep(timeout)
            raise RigctlError("it does not answer")
        return self.answers[folder.name]

    @contextmanager
    def opened(self, rig: Rig, _: Access) -> Iterator[Bench]:
        assert rig is self.rig
        if self.unreachable is not None:
            raise self.unreachable
        self.bench.opened += 1
        yield self.bench

    def run(self, name: str, *, answers: str | None = None, age: float = 0.0, **facts: Any) -> Path:
        """A run in progress on this bench, at its port."""
        number = len(list((self.folder / "runs").glob("2*")))
        folder = self.folder / "runs" / f"20261121-09300{number}-{name}"
        folder.mkdir(parents=True)
        (folder / "log.jsonl").touch()
        header = RunHeader(
            folder.name, Source("heat"), Source(facts.pop("rig", self.rig.name)), LAYOUT, STARTED
        ).to_json()
        backend = facts.pop("backend", {"port": PORT})
        write_info(folder, {**header, "backend": backend, "status": "running", "reason": None})
        self.beat(folder, **{"state": "running", "unconfirmed": None} | facts)
        moment = wall.time() - age
        os.utime(folder / "state.json", (moment, moment))
        if answers is not None:
            self.answers[folder.name] = answers
        return folder

    def beat(self, folder: Path, **fields: object) -> None:
        (folder / "state.json").write_text(json.dumps(fields), encoding="utf-8")

    @contextmanager
    def holding(
        self, run: Path | None, rig: str = "", port: Mapping[str, str] | str = PORT
    ) -> Iterator[None]:
        """A program that has the lock of an address."""
        how = Access(runs=self.folder, options={"port": port}, lock_folder=self.folder / "locks")
        for address in addresses_in(self.rig, how).values():
            with RigLock(rig or self.rig.name, "a run", self.folder / "locks", key=address.key) as lock:
                if run is not None:
                    lock.take_for(run)
                yield
                return


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Scene:
    return make(tmp_path, monkeypatch, parse_rig(TCLAB))


def make(folder: Path, monkeypatch: pytest.MonkeyPatch, rig: Rig, **options: Any) -> Scene:
    made = Scene(folder, rig, **options)
    monkeypatch.setattr(off, "monotonic", lambda: made.now)
    for name in ("send", "sleep", "opened"):
        monkeypatch.setattr(off, name, getattr(made, name))
    return made


# --- the bench is commanded from here ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("read", "answered", "confirmed", "known_by"),
    [
        ("12", "", True, "read back from the bench"),
        ("12", "12", True, "read back from the bench"),
        ("", "12", True, "the bench has answered each command"),
        ("1", "2", True, "read back from the bench; heater_2: the bench has answered the command"),
        ("1", "", False, "sent, not confirmed: heater_2; see for yourself whether it is off"),
        ("", "", False, "sent, not confirmed: heater_1, heater_2; see for yourself whether it is off"),
    ],
)
def test_what_is_read_or_answered_is_confirmed(
    scene: Scene, read: str, answered: str, confirmed: bool, known_by: str
) -> None:
    scene.bench.outputs_read = frozenset(f"heater_{one}" for one in read)
    scene.bench.outputs_answered = frozenset(f"heater_{one}" for one in answered)
    done = f"{SAFE if confirmed else UNSAFE} ({known_by})"
    assert scene.off() == off.SwitchedOff(done, confirmed, known_by)
    assert (scene.bench.made_safe, scene.bench.samples) == (1, 1)
    assert scene.bench.rates == [scene.rig.monitor_rate]


def test_an_output_that_is_on_all_the_same_is_an_error(scene: Scene) -> None:
    scene.bench.commands["heater_1"] = 0.6
    with pytest.raises(RigctlError, match="heater_1 is 60 %, though it was commanded to be safe") as caught:
        scene.off()
    assert caught.value.exit_code is ExitCode.FAILED


def test_what_an_operator_sets_by_hand_is_neither_confirmed_nor_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    changed = TCLAB.replace(
        "actuators:\n  heater_1: {kind", "actuators:\n  fan: {kind: switch, by: operator}\n  heater_1: {kind"
    )
    assert changed != TCLAB
    for safe_state in (changed, changed.replace("safe_state: {", "safe_state: {fan: off, ")):
        scene = make(tmp_path, monkeypatch, parse_rig(safe_state))
        scene.bench.outputs_read = scene.bench.outputs_answered = frozenset({"heater_1", "heater_2"})
        scene.bench.commands["fan"] = 1.0
        assert scene.off().known_by == "read back from the bench"


@pytest.mark.parametrize(("rate", "waited"), [(4.0, 0.5), (1.0, 1.0), (0.5, 1.0)])
def test_a_bench_that_gives_no_sample_is_not_waited_for_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rate: float, waited: float
) -> None:
    text = f"monitor_rate: {rate} Hz\n" + "\n".join(
        line for line in TCLAB.splitlines() if not line.startswith("monitor_rate")
    )
    scene = make(tmp_path, monkeypatch, parse_rig(text))
    scene.bench.silent = set(scene.rig.parts)
    assert scene.off().known_by == "the bench has answered each command"
    assert scene.bench.clock.now() == pytest.approx(waited)


def test_a_device_that_gives_no_sample_confirms_nothing_by_reading(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = parse_rig(shipped("rigs", "oil-circuit-devices.yaml").read_text(encoding="utf-8"))
    ports = {"controller": "10.0.0.1:502", "plant": "opc.tcp://10.0.0.2:4840", "meter": "10.0.0.3:5025"}
    scene = make(tmp_path, monkeypatch, rig, options={"port": ports})
    driven = [name for name in rig.safe_state if rig.actuators[name].by == "driven"]
    scene.bench.outputs_read = frozenset(driven)
    scene.bench.outputs_answered = frozenset()
    assert scene.off().known_by == "read back from the bench"
    assert scene.bench.samples == 3, "until each device has given one"
    silent = rig.device_of(driven[0])
    scene.bench.silent = {silent}
    done = scene.off()
    gone = ", ".join(name for name in driven if rig.device_of(name) == silent)
    assert (done.confirmed, done.known_by) == (
        False,
        f"sent, not confirmed: {gone}; see for yourself whether it is off",
    )


def test_what_the_bench_reports_is_told(scene: Scene) -> None:
    scene.bench.notices = [Notice(0.0, "note", "reconnected"), Notice(0.0, "note", "resynchronised")]
    assert scene.off().done == f"{SAFE}; reconnected; resynchronised (read back from the bench)"


def test_a_board_that_has_tripped_is_safe_already(scene: Scene) -> None:
    scene.bench.trouble = BenchTripped("too hot")
    done = scene.off()
    assert done.confirmed
    assert done.done == (
        f"{SAFE}; the board has tripped: too hot; '--clear-trips' clears it once its cause is gone "
        "(the bench has answered each command)"
    )


def test_outputs_that_are_not_safe_have_to_be_switched_off_by_hand(scene: Scene) -> None:
    scene.bench.trouble = OutputsNotSafe("heater_1 may be on", {"heater_1": 0.6})
    known_by = "heater_1 may be on; switch it off by hand, at its supply"
    assert scene.off() == off.SwitchedOff(f"{UNSAFE} ({known_by})", False, known_by)


def test_a_bench_out_of_reach_is_reported_with_what_to_do(scene: Scene) -> None:
    scene.unreachable = BackendLost("no answer", value="COM3")
    with pytest.raises(BackendLost, match="no answer") as caught:
        scene.off()
    assert (caught.value.value, "by hand" in str(caught.value.hint)) == ("COM3", True)


def test_a_bench_is_taken_from_whoever_has_it(scene: Scene) -> None:
    with scene.holding(None):
        assert scene.off().confirmed
    assert scene.asked == []


# --- runs are asked first ------------------------------------------------------------------------------


def test_a_run_that_has_the_bench_and_confirms_is_believed(scene: Scene) -> None:
    run = scene.run("heat", answers="ending")
    scene.later.append((100.5, lambda: scene.beat(run, state="finishing", unconfirmed=None)))
    with scene.holding(run):
        done = scene.off()
    told = f"{run.name}: ending"
    assert done == off.SwitchedOff(told, True, BY_RUN, (told,))
    assert (scene.asked, scene.bench.opened) == ([run.name], 0)


@pytest.mark.parametrize(
    ("answers", "fields", "after"),
    [
        (None, {"state": "finishing", "unconfirmed": None}, 0.0),  # it hangs
        ("ending", {"state": "finishing", "unconfirmed": "heater_1 60 %"}, 0.0),
        ("ending", {"state": "failed", "unconfirmed": "heater_1 60 %"}, 0.0),
        ("ending", {"state": "finishing"}, 0.0),  # a version that does not say
        ("ending", {"state": "safe", "unconfirmed": None}, 0.0),
        ("ending", {"state": "finishing", "unconfirmed": None}, 1.0),  # too late
        ("ending", None, 0.0),
    ],
)
def test_a_run_that_does_not_confirm_loses_the_bench(
    scene: Scene, answers: str | None, fields: dict[str, object] | None, after: float
) -> None:
    run = scene.run("heat", answers=answers)
    if fields is None:
        (run / "state.json").unlink()
    elif after:
        scene.later.append((100.0 + after, lambda: scene.beat(run, **fields)))
    else:
        scene.beat(run, **fields)
    with scene.holding(run):
        done = scene.off()
    told = f"{run.name}: {answers or 'it does not answer'}"
    assert done.done == f"{told}; {SAFE} (read back from the bench)"
    assert (done.confirmed, done.ended, scene.bench.made_safe) == (True, (told,), 1)


@pytest.mark.parametrize("state", ["finished", "failed", "aborted"])
def test_a_run_that_has_just_ended_has_confirmed(scene: Scene, state: str) -> None:
    run = scene.run("heat", answers="ending", state=state)
    with scene.holding(run):
        assert scene.off().known_by == BY_RUN


def test_runs_without_the_bench_are_asked_and_do_not_speak_for_it(scene: Scene) -> None:
    run = scene.run("heat", answers="ending", state="running")
    assert scene.off().known_by == "read back from the bench"
    assert (scene.asked, scene.now) == ([run.name], 100.0), "nobody waits for its word"


def test_many_runs_that_do_not_answer_do_not_delay_the_bench(scene: Scene) -> None:
    holder = scene.run("holder")
    others = [scene.run(f"other{number}") for number in range(6)]
    with scene.holding(holder):
        done = scene.off()
    assert scene.asked == [holder.name, *(run.name for run in reversed(others[3:]))]
    assert scene.asked.count(holder.name) == 1
    assert done.ended[4:] == tuple(f"{run.name}: not asked" for run in reversed(others[:3]))


def test_every_run_that_has_the_bench_is_asked_however_long_it_takes(scene: Scene) -> None:
    runs = [scene.run(f"holder{number}") for number in range(6)]
    ports = [f"socket://10.0.0.{number}:5000" for number in range(6)]
    with ExitStack() as held:
        for run, port in zip(runs, ports, strict=True):
            held.enter_context(scene.holding(run, port=port))
        scene.options = {}
        scene.unreachable = BackendLost("no port")
        with pytest.raises(RigctlError):
            scene.off()
    assert sorted(scene.asked) == sorted(run.name for run in runs)


@pytest.mark.parametrize(
    ("facts", "asked"),
    [
        ({}, True),
        ({"age": 3600.0}, False),
        ({"state": "paused"}, True),
        ({"state": "finished"}, False),
        ({"state": "failed"}, False),
        ({"state": "aborted"}, False),
        ({"rig": "another rig"}, False),
        ({"backend": "damaged"}, False),
        ({"backend": {"port": "socket://10.0.0.7:5000"}}, True),  # the bench was named by its rig file
    ],
)
def test_runs_in_progress_on_a_bench_of_this_name_are_asked(
    scene: Scene, facts: dict[str, Any], asked: bool
) -> None:
    scene.options = {}
    run = scene.run("heat", answers="ending", **facts)
    (scene.folder / "runs" / "20261121-093009-empty").mkdir()
    scene.unreachable = BackendLost("no port")
    with pytest.raises(RigctlError):
        scene.off()
    assert scene.asked == [run.name] * asked


def test_the_rig_file_s_own_port_is_no_other_port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With or without `--port`: a run that was given another one is asked as well."""
    text = TCLAB.replace("backend:\n", f"backend:\n  port: {PORT}\n", 1)
    scene = make(tmp_path, monkeypatch, parse_rig(text))
    run = scene.run("heat", answers="ending", backend={"port": "socket://10.0.0.7:5000"})
    for options in ({}, {"port": PORT}):
        scene.options = dict(options)
        assert scene.off().confirmed
    assert scene.asked == [run.name] * 2


@pytest.mark.parametrize(
    ("backend", "asked"),
    [
        ({"port": PORT}, True),
        ({"port": "socket://10.0.0.7:5000"}, False),
        ({}, True),  # a port that is not known may be this one
    ],
)
def test_runs_at_another_port_go_on(scene: Scene, backend: object, asked: bool) -> None:
    run = scene.run("heat", answers="ending", backend=backend)
    assert scene.off().confirmed
    assert scene.asked == [run.name] * asked


@pytest.mark.parametrize(("meter", "asked"), [("10.0.0.3:5025", True), ("10.0.0.4:5025", False)])
def test_runs_at_other_addresses_of_several_devices_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, meter: str, asked: bool
) -> None:
    """One address in common is enough."""
    rig = parse_rig(shipped("rigs", "oil-circuit-devices.yaml").read_text(encoding="utf-8"))
    ports = {"controller": "10.0.0.1:502", "plant": "opc.tcp://10.0.0.2:4840", "meter": "10.0.0.3:5025"}
    scene = make(tmp_path, monkeypatch, rig, options={"port": ports})
    theirs = {"controller": "10.0.0.8:502", "plant": "opc.tcp://10.0.0.9:4840", "meter": meter}
    known = {f"{name}.port": port for name, port in theirs.items()}
    run = scene.run("heat", answers="ending", backend=known)
    scene.off()
    assert scene.asked == [run.name] * asked


def test_a_run_of_this_bench_at_another_port_is_not_asked_where_a_port_is_given(scene: Scene) -> None:
    run = scene.run("heat", answers="ending", backend={"port": "socket://10.0.0.7:5000"})
    with scene.holding(run, port="socket://10.0.0.7:5000"):
        assert scene.off().confirmed
    assert scene.asked == []


@pytest.mark.parametrize(
    ("rig", "state", "believed"),
    [("", "finishing", True), ("another rig", "finishing", False), ("", "running", False)],
)
def test_a_run_that_was_given_another_port_speaks_for_a_bench_that_is_not_there(
    scene: Scene, rig: str, state: str, believed: bool
) -> None:
    run = scene.run("heat", answers="ending", state=state)
    scene.unreachable = BackendLost("no answer")
    if rig:  # it has the address, but another safe state
        other = scene.run("other", answers="ending", state="finishing")
        scene.options = {"port": PORT}
        with scene.holding(run), scene.holding(other, rig=rig, port="socket://10.0.0.7:5000"):
            assert scene.off().known_by == BY_RUN, "the one that has the address"
        with scene.holding(run, rig=rig), pytest.raises(BackendLost):
            scene.beat(run, state="running")
            scene.off()
        return
    scene.options = {}  # the rig file names no port
    with scene.holding(run, port="socket://10.0.0.7:5000"):
        if believed:
            assert scene.off().known_by == BY_RUN
        else:
            with pytest.raises(RigctlError):
                scene.off()


def test_a_bench_that_is_not_there_and_that_no_run_has_is_an_error(scene: Scene) -> None:
    scene.run("heat", answers="ending", state="finishing")
    scene.unreachable = BackendLost("no answer")
    with pytest.raises(BackendLost):
        scene.off()


# --- a bench that exists only in its process -----------------------------------------------------------


def test_a_simulated_bench_ends_with_its_runs(scene: Scene) -> None:
    scene.backend, scene.options = "simulated", {}
    first, second = (scene.run(name, answers="ending", state="finishing") for name in ("first", "second"))
    done = scene.off()
    known_by = "a simulated bench lives in the process that uses it: no real one was touched"
    told = (f"{second.name}: ending", f"{first.name}: ending")
    assert done == off.SwitchedOff("; ".join((*told, f"{SAFE} ({known_by})")), True, known_by, told)
    assert scene.bench.opened == 0
    scene.beat(first, state="finishing", unconfirmed="heater_1 60 %")
    done = scene.off()
    known_by = "a run has not said that its outputs are safe"
    assert done == off.SwitchedOff(
        "; ".join((*told, f"OUTPUTS NOT CONFIRMED SAFE ({known_by})")), False, known_by, told
    )


def test_a_simulated_bench_is_taken_from_who_moves_it_by_hand(scene: Scene) -> None:
    scene.backend, scene.options = "simulated", {}
    with RigLock(scene.rig.name, "moving it", scene.folder / "locks"):
        assert scene.off().confirmed


def test_a_private_simulation_asks_no_holder(scene: Scene) -> None:
    scene.backend, scene.options, scene.exclusive = "simulated", {}, False
    run = scene.run("heat", answers="ending", age=3600.0)
    with RigLock(scene.rig.name, "a run", scene.folder / "locks") as lock:
        lock.take_for(run)
        assert scene.off().confirmed
    assert scene.asked == []


@pytest.mark.parametrize("real", [False, True])
def test_a_bench_of_several_devices_is_real_if_one_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, real: bool
) -> None:
    if real:
        text = shipped("rigs", "oil-circuit-devices.yaml").read_text(encoding="utf-8")
        rig = parse_rig(text)
        ports = {"controller": "10.0.0.1:502", "plant": "opc.tcp://10.0.0.2:4840", "meter": "10.0.0.3:5025"}
        scene = make(tmp_path, monkeypatch, rig, options={"port": ports})
    else:
        part = "{unit: V, quantity: voltage, device: "
        text = "name: two\ndevices: {a: {kind: simulated}, b: {kind: simulated}}\n"
        text += f"channels: {{va: {part}a}}, vb: {part}b}}}}\n"
        text += "actuators: {x: {device: a, kind: switch}}\nsafe_state: {x: off}\n"
        scene = make(tmp_path, monkeypatch, parse_rig(text), options={})
    known_by = scene.off().known_by
    assert (scene.bench.opened == 1) is real
    assert ("a simulated bench lives in the process" in known_by) is not real
