"""One program at a time commands a bench; the lock of a dead program is taken over."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from rigctl.clock import VirtualClock
from rigctl.errors import ExitCode, RigctlError
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig, parse_rig
from rigctl.runner import rig_lock as locks
from rigctl.runner.bench_access import Access, held
from rigctl.runner.launch import Launch
from rigctl.runner.manual import watch
from rigctl.runner.operators.automatic_operator import AutomaticOperator
from rigctl.runner.operators.requests import Request
from rigctl.runner.rig_lock import RigLock, owners, read_owner
from rigctl.runner.snapshot import View
from rigctl.runner.switch_off import switch_off

NAME = "HL32 bench"
RIG = Path(__file__).parents[2] / "rigs" / "hl32-bench.yaml"


def owner_file(folder: Path) -> Path:
    return folder / "hl32-bench.json"


def pretend(folder: Path, **changes: object) -> None:
    """Change entries of the owner's file."""
    path = owner_file(folder)
    fields = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps({**fields, **changes}), encoding="utf-8")


def test_a_second_program_is_refused_and_told_which_one_has_the_bench(tmp_path: Path) -> None:
    with RigLock(NAME, "a run of 'campaign'", tmp_path):
        with pytest.raises(RigctlError, match="'HL32 bench' is in use by a run of 'campaign'") as refused:
            RigLock(NAME, "another", tmp_path).__enter__()
        assert refused.value.exit_code is ExitCode.FAILED
        assert str(os.getpid()) in str(refused.value)
        with RigLock("another bench", "a run", tmp_path):
            pass
    with RigLock(NAME, "another", tmp_path):
        pass
    assert not owner_file(tmp_path).exists()


def test_the_lock_of_a_killed_owner_is_taken_over_at_once(tmp_path: Path) -> None:
    code = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from rigctl.runner.rig_lock import RigLock\n"
        f"RigLock({NAME!r}, 'a run', Path({str(tmp_path)!r})).__enter__()\n"
        "print('held', flush=True)\n"
        "sys.stdin.read()\n"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    assert child.stdin is not None
    assert child.stdout.readline() == "held\n"
    with pytest.raises(RigctlError, match="in use"):
        RigLock(NAME, "me", tmp_path).__enter__()
    child.kill()
    child.wait()
    child.stdin.close()
    child.stdout.close()
    with RigLock(NAME, "me", tmp_path) as mine:
        owner = mine.owner()
        assert owner is not None
        assert owner.pid == os.getpid()


def test_an_owner_without_heartbeat_loses_its_lock_and_is_ordered_to_abort(tmp_path: Path) -> None:
    with RigLock(NAME, "asleep", tmp_path) as sleeper:
        sleeper.publish(View("", "running", 0.0))
        pretend(tmp_path, beat=time.monotonic() - locks.OLD - 1.0)
        with RigLock(NAME, "awake", tmp_path):
            sleeper._next_beat = 0.0
            sleeper.publish(View("", "running", 0.0))
            (order,) = sleeper.poll()
            assert order.request is Request.ABORT
            assert "taken the bench over" in order.source
            owner = read_owner(owner_file(tmp_path))
            assert owner is not None
            assert owner.purpose == "awake"
    assert not owner_file(tmp_path).exists()


def test_the_calendar_clock_does_not_affect_locks_of_this_computer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with RigLock(NAME, "a run", tmp_path):
        monkeypatch.setattr(locks.time, "time", lambda: 4e9)
        with pytest.raises(RigctlError, match="in use"):
            RigLock(NAME, "me", tmp_path).__enter__()


def test_an_owner_on_another_computer_is_judged_by_its_heartbeat(tmp_path: Path) -> None:
    with RigLock(NAME, "elsewhere", tmp_path):
        pretend(tmp_path, host="another", pid=1)
        with pytest.raises(RigctlError, match="on another"):
            RigLock(NAME, "me", tmp_path).__enter__()
        pretend(tmp_path, host="another", date=time.time() - locks.OLD - 1.0)
        with RigLock(NAME, "me", tmp_path):
            pass


@pytest.mark.parametrize("content", ["", "{", "[]", '{"token": 1}', "\x00\xff"])
def test_a_damaged_lock_file_does_not_prevent_locking(tmp_path: Path, content: str) -> None:
    owner_file(tmp_path).write_text(content, encoding="utf-8")
    with RigLock(NAME, "me", tmp_path):
        pass


def test_an_unwritable_lock_folder_is_reported(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("", encoding="utf-8")
    with pytest.raises(RigctlError, match="cannot lock the bench"):
        RigLock(NAME, "me", blocked / "locks").__enter__()


def test_making_safe_takes_the_bench_from_its_owner(tmp_path: Path) -> None:
    with RigLock(NAME, "a jog", tmp_path) as other:
        other.beat()
        with RigLock(NAME, "off", tmp_path, at_any_cost=True):
            pass
        other._next_beat = 0.0
        other.beat()
        assert [order.request for order in other.poll()] == [Request.ABORT]
        assert other.poll() == ()


def test_making_safe_works_without_a_lock_folder(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("", encoding="utf-8")
    with RigLock(NAME, "off", blocked / "locks", at_any_cost=True):
        pass


def test_a_monitor_keeps_its_bench_and_ends_when_it_is_taken_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(locks, "_BEAT", 0.0)
    rig = load_rig(RIG)
    how = Launch(
        runs=tmp_path, operator=AutomaticOperator(), options={"plant": "roles"}, lock_folder=tmp_path
    )
    readings = watch(rig, replace(how, clock=VirtualClock()), 10.0)
    next(readings)
    pretend(tmp_path, beat=0.0)
    next(readings)
    owner = read_owner(owner_file(tmp_path))
    assert owner is not None
    assert owner.alive
    assert switch_off(rig, replace(how, clock=VirtualClock())).done.startswith("outputs are safe")
    with pytest.raises(RigctlError, match="taken the bench"):
        list(readings)


def test_one_address_is_locked_whatever_the_bench_is_called(tmp_path: Path) -> None:
    with (
        RigLock("oven", "a run", tmp_path, key="tcp 127.0.0.1 7018"),
        pytest.raises(RigctlError, match="'oven B' is in use, as 'oven', by a run"),
    ):
        RigLock("oven B", "another", tmp_path, key="tcp 127.0.0.1 7018").__enter__()


def test_equal_benches_at_other_addresses_exclude_nobody(tmp_path: Path) -> None:
    with (
        RigLock("oven", "a run", tmp_path, key="tcp 127.0.0.1 7018"),
        RigLock("oven", "another", tmp_path, key="tcp 127.0.0.1 7019"),
        RigLock("oven", "a simulation", tmp_path),
    ):
        assert [owner.purpose for owner in owners("oven", tmp_path)] == ["a simulation", "a run", "another"]
        assert owners("another oven", tmp_path) == []


def access(tmp_path: Path, **options: object) -> Access:
    return Access(runs=tmp_path / "runs", lock_folder=tmp_path, options=options)


def test_the_lock_of_a_device_on_the_network_is_on_its_address(tmp_path: Path) -> None:
    rig = load_rig(shipped("rigs", "oil-circuit-modbus.yaml"))
    renamed = parse_rig(rig.text.replace(f"name: {rig.name}", "name: another name"))
    with held(rig, "a run", access(tmp_path, port="localhost:1502")):
        other = access(tmp_path, port="127.0.0.1:1502")
        with pytest.raises(RigctlError, match="is in use"), held(renamed, "b", other):
            pass
        with held(rig, "c", access(tmp_path, port="localhost:1503")):
            pass
