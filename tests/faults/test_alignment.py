"""`rigctl doctor --align` on real servers of three protocols, whose readings are old by a planted time."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any

import pytest

from commands import call, refusal
from patience import unhurried
from rigctl.backends.combined import bench as combined
from rigctl.errors import ExitCode
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig
from several_devices import AGES, ALIGN, SeveralDevices, patient_devices, wired_devices

CHANNELS = {"controller": "oil_temperature", "plant": "supply_pressure", "meter": "line_temperature"}


@pytest.fixture(scope="module")
def devices() -> Iterator[SeveralDevices]:
    with wired_devices() as served:
        yield served


@pytest.fixture
def project(devices: SeveralDevices, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr("rigctl.runner.rig_lock._state_folder", lambda: tmp_path / "locks")
    monkeypatch.setattr(combined, "_SAFE_WITHIN", 60.0)
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    text = shipped("rigs", "oil-circuit-devices.yaml").read_text(encoding="utf-8")
    (tmp_path / "rig.yaml").write_text(patient_devices(text) + ALIGN, encoding="utf-8")
    with unhurried(), chdir(tmp_path):
        yield tmp_path
    devices.circuit.switched.clear()


def test_planted_offsets_are_found_and_written(devices: SeveralDevices, project: Path) -> None:
    before = Path("rig.yaml").read_text("utf-8")
    done = call("doctor", "--align", "--rig", "rig.yaml", *devices.options, "--yes", "--write", "--json")
    assert done.exit_code == 0, done.output
    assert devices.circuit.off
    assert [name for _, name, _ in devices.circuit.switched] == ["relief_valve"] * 10
    found = json.loads(done.stdout)
    assert found["actuator"] == "relief_valve"
    assert {one["device"]: one["channel"] for one in found["aligned"]} == CHANNELS
    for one in found["aligned"]:
        assert abs(one["behind"] + AGES[one["device"]]) < one["uncertainty"], one
        assert one["uncertainty"] < 0.15
    assert found["written"]
    assert Path(found["backup"]).read_text("utf-8") == before
    assert "# not yet measured" in Path("rig.yaml").read_text("utf-8")
    clocks = load_rig(project / "rig.yaml").clocks
    names = {"controller": "controller", "plant": "plant", "meter": "lab"}
    assert {name: clocks[clock].channels for name, clock in names.items()} == {
        name: (channel,) for name, channel in CHANNELS.items()
    }
    for one in found["aligned"]:
        assert one["clock"] == names[one["device"]]
        clock = clocks[one["clock"]]
        assert clock.offset == pytest.approx(one["behind"], abs=1e-3)
        assert one["uncertainty"] <= clock.uncertainty <= 1.2 * one["uncertainty"]


def test_a_channel_that_does_not_respond_leaves_nothing_measured(
    devices: SeveralDevices, project: Path
) -> None:
    meter: Any = devices.servers["meter"].circuit
    meter.connected = False
    before = Path("rig.yaml").read_text("utf-8")
    try:
        message = refusal(
            "doctor", "--align", "--rig", "rig.yaml", *devices.options, "--yes", "--write",
            exit_code=ExitCode.FAILED,
        )  # fmt: skip
    finally:
        meter.connected = True
    assert "line_temperature does not respond to the output" in message
    assert "No offset was measured" in message
    assert "pressure" not in message
    assert Path("rig.yaml").read_text("utf-8") == before
    assert devices.circuit.off


def test_it_says_what_the_rig_file_should_say_and_what_was_not_measured(
    devices: SeveralDevices, project: Path
) -> None:
    """Nobody is at a terminal to agree, so that nothing is written."""
    text = Path("rig.yaml").read_text("utf-8")
    one = text.replace(
        "channels: [oil_temperature, supply_pressure, line_temperature]", "channels: [oil_temperature]"
    )
    Path("rig.yaml").write_text(one, "utf-8")
    done = call("doctor", "--align", "--rig", "rig.yaml", *devices.options, "--yes")
    assert done.exit_code == 0, done.output
    first, *others = done.stdout.splitlines()
    assert re.match(
        r"controller: [\d.]+ ms ahead of the commands, ±[\d.]+ ms \(95 %, 10 edges of relief", first
    )
    assert others[:4] == [
        "plant: not measured, none of its channels is in 'align'",
        "meter: not measured, none of its channels is in 'align'",
        "in the rig file:",
        "clocks:",
    ]
    entry = r"  controller: \{channels: \[oil_temperature\], offset: -[\d.]+ ms, uncertainty: [\d.]+ ms\}"
    assert re.fullmatch(entry, others[4])
    assert Path("rig.yaml").read_text("utf-8") == one


def test_a_hold_too_short_for_a_slow_device_is_refused(devices: SeveralDevices, project: Path) -> None:
    text = Path("rig.yaml").read_text("utf-8")
    Path("rig.yaml").write_text(text.replace("hold: 2 s", "hold: 0.9 s"), "utf-8")
    message = refusal("doctor", "--align", "--rig", "rig.yaml", *devices.options, "--yes")
    assert "plant is read too slowly for this hold, got '0.9 s'; expected 'hold: 1 s' or longer" in message


def test_a_rig_file_without_an_edge_is_refused(devices: SeveralDevices, project: Path) -> None:
    text = Path("rig.yaml").read_text("utf-8")
    Path("rig.yaml").write_text(text.partition("\nalign:")[0], "utf-8")
    message = refusal("doctor", "--align", "--rig", "rig.yaml", *devices.options, "--yes")
    assert "nothing says which output the devices see" in message
    assert "--yes and --write belong to --align" in refusal("doctor", "--yes")


def test_nothing_moves_unless_somebody_agrees(devices: SeveralDevices, project: Path) -> None:
    message = refusal("doctor", "--align", "--rig", "rig.yaml", *devices.options)
    assert "this moves an output: relief_valve is set to 30 bar and back to 0 bar, 5 times in 20 s" in message
    assert not devices.circuit.switched


def test_a_limit_ends_it_safely_and_nothing_is_measured(devices: SeveralDevices, project: Path) -> None:
    text = Path("rig.yaml").read_text("utf-8")
    Path("rig.yaml").write_text(text.replace("above: 65 bar", "above: 20 bar"), "utf-8")
    done = call("doctor", "--align", "--rig", "rig.yaml", *devices.options, "--yes")
    assert done.exit_code == ExitCode.FAILED
    assert "failed: Supply over-pressure" in done.output, "the place in a generated procedure helps nobody"
    assert "behind" not in done.output
    assert devices.circuit.off
