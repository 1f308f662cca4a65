"""How old a reading may become: of a channel, of its device, of the rig; the nearest statement counts."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from commands import call
from rigctl.dataset import open_run
from rigctl.files.shipped import shipped
from rigctl.rig import Rig, parse_rig
from rigctl.runner.interlocks import Alarm, Interlocks

PROCEDURE = "procedure: wait\nrig: rig.yaml\nsteps: [wait: 12 s]\n"

limit = st.none() | st.integers(1, 40).map(lambda tenths: tenths / 10.0)


def two(rig: float | None, device: float | None, first: float | None, second: float | None) -> Rig:
    def stated(value: float | None) -> str:
        return "" if value is None else f", stale_after: {value} s"

    return parse_rig(
        f"""\
name: two
monitor_rate: 50 Hz
{"" if rig is None else f"stale_after: {rig} s"}
devices:
  a: {{kind: simulated{stated(device)}}}
  b: {{kind: simulated, stale_after: 90 s}}
channels:
  va: {{device: a, unit: V, quantity: voltage{stated(first)}}}
  vc: {{device: a, unit: V, quantity: voltage{stated(second)}}}
  vb: {{device: b, unit: V, quantity: voltage}}
"""
    )


def alarms_without(rig: Rig, missing: set[str]) -> list[Alarm]:
    """The alarms of 5 s at 50 Hz in which some channels of device a have no value from 0.5 s on."""
    locks = Interlocks(rig)
    found: list[Alarm] = []
    for number in range(250):
        time = number / 50.0
        values = [math.nan if name in missing and time >= 0.5 else 0.0 for name in ("va", "vc")]
        found += locks.check((time, -1.0, *values, math.nan), "a")
    return found


@given(rig=limit, device=limit, first=limit, second=limit)
def test_a_sensor_is_broken_after_the_nearest_limit(
    rig: float | None, device: float | None, first: float | None, second: float | None
) -> None:
    made = two(rig, device, first, second)
    inherited = device or rig or 1.0
    expected = {"va": first or inherited, "vc": second or inherited}
    alarms = alarms_without(made, set(expected))
    assert {one.channel: one.time - 0.5 for one in alarms} == pytest.approx(expected, abs=0.021)
    for one in alarms:
        own = {"va": first, "vc": second}[one.channel]
        owner = one.channel if own else "a" if device else ""
        said = f"; stale_after of {owner} is {expected[one.channel]:g} s" if owner else ""
        assert one.message == f"{one.channel} gives no value: sensor or line broken{said}"


@given(rig=limit, device=limit, first=limit, second=limit)
def test_silence_of_a_device_is_a_fault_once_its_first_channel_is_stale(
    rig: float | None, device: float | None, first: float | None, second: float | None
) -> None:
    made = two(rig, device, first, second)
    locks = Interlocks(made)
    inherited = device or rig or 1.0
    expected = min(first or inherited, second or inherited)
    locks.check((0.0, -1.0, 0.0, 0.0, math.nan), "a")
    assert locks.check_devices(expected - 0.01, 0.0, 50.0) == ("", None)
    silent, alarm = locks.check_devices(expected, 0.0, 50.0)
    assert silent == "a"
    assert alarm is not None
    own = first if (first or inherited) == expected else second
    named = ("va" if own == first else "vc") if own else "a" if device else ""
    said = f"; stale_after of {named} is {expected:g} s" if named else ""
    assert alarm.message == f"a: no reading for {expected:.3g} s, expected one every 0.02 s{said}"


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    (tmp_path / "procedure.yaml").write_text(PROCEDURE, encoding="utf-8")
    write_rig(tmp_path, "")
    return tmp_path


def write_rig(folder: Path, stated: str) -> None:
    text = shipped("rigs", "oil-circuit-modbus.yaml").read_text(encoding="utf-8")
    before = "  supply_pressure:\n"
    assert before in text
    text = text.replace(before, before + f"    {stated}\n" * bool(stated))
    (folder / "rig.yaml").write_text(text, encoding="utf-8")


def simulate(*faults: str) -> tuple[str, str | None, float]:
    options = [word for fault in faults for word in ("--fault", fault)]
    document = json.loads(call("simulate", "procedure.yaml", *options, "--json").stdout)
    return document["status"], document["reason"], open_run("latest").samples()["time"].max()


def test_a_sensor_may_be_missing_for_as_long_as_its_channel_says(project: Path) -> None:
    fault = "sensor_open:supply_pressure@3 s..6 s"
    status, reason, ended = simulate(fault)
    assert (status, "stale_after" in str(reason)) == ("failed", False)
    assert ended < 5.5
    write_rig(project, "stale_after: 4 s")
    status, reason, _ = simulate(fault)
    assert status == "finished", reason
    status, reason, ended = simulate("sensor_open:supply_pressure@3 s")
    assert status == "failed"
    assert "sensor or line broken; stale_after of supply_pressure is 4 s" in str(reason)
    assert ended == pytest.approx(7.0, abs=0.2)


def test_silence_is_a_fault_once_the_first_channel_is_stale(project: Path) -> None:
    fault = "samples_stop@3 s..3.7 s"
    status, reason, _ = simulate(fault)
    assert status == "finished", reason
    write_rig(project, "stale_after: 0.5 s")
    status, reason, _ = simulate(fault)
    assert status == "failed"
    assert "no sample for 0.5 s, expected one every 0.1 s; stale_after of supply_pressure is 0.5 s" in str(
        reason
    )
