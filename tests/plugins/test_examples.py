"""The example plug-ins, installed as packages, on real servers: the contract, and whole journeys."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import own_process
from patience import unhurried
from plugins.stands import Stand
from rigctl.backends.registry import create_backend
from rigctl.clock import real_clock
from rigctl.dataset import open_run
from rigctl.rig import load_rig
from rigctl.testing.contract import BackendContract, Subject
from systems import needs_package

KINDS = [pytest.param(kind, marks=needs_package(f"rigctl_{kind}")) for kind in ("epics", "mqtt", "can")]
#: changes of the rig file, and what is said about each
WRONG = {
    "epics": [
        ("OVEN:TEMPERATURE", "OVEN:TEMPERATUR", "no server has OVEN:TEMPERATUR, the others are there"),
        ("OVEN:TEMPERATURE", "OVEN:LABEL", "OVEN:LABEL holds 7 CHAR, not a number"),
    ],
    "mqtt": [
        ("oven/temperature", "oven/temperatur", "nothing is published on 'oven/temperatur'"),
        ("oven/temperature", "oven/label", "'oven/label' says 'an oven', which is no number"),
    ],
    "can": [
        ("Status.Temperature", "Status.Temperatur", "unknown signal, got 'Status.Temperatur'"),
        ("dbc: oven.dbc", "dbc: ovens.dbc", "the file of the messages cannot be read"),
    ],
}
ABSENT = {
    "epics": "no EPICS server answers",
    "mqtt": "no MQTT broker answers",
    "can": "nobody sends Status",
}
LOST = {
    "epics": "the EPICS server",
    "mqtt": "'oven/status' says 'offline'",
    "can": "Status has not come for 5 s",
}
#: what is said where the fan does not do what it is told
OTHERWISE = {
    "epics": "the device has set fan to 80 % by itself",
    "mqtt": "error oven/fan says '80' after",
    "can": "error Status.FanSpeed says 80 after 100 was set",
}


@pytest.fixture(params=KINDS)
def stand(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Stand]:
    """Each example with its device."""
    made = Stand(request.param, tmp_path)
    yield made
    made.close()


class TestContract(BackendContract):
    """The public tests for backends."""

    @pytest.fixture(autouse=True)
    def _made(self, stand: Stand) -> Iterator[None]:
        stand.be_patient()
        rig = load_rig(stand.rig)
        self._subject = Subject(
            stand.kind,
            rig,
            lambda: create_backend(rig, None, real_clock()),
            lambda: stand.device.outputs,
        )
        with unhurried():
            yield

    def subject(self) -> Subject:
        return self._subject


def test_doctor_reads_it_and_a_run_drives_it(stand: Stand) -> None:
    stand.be_patient()
    code, out, err = own_process.rigctl(stand.folder, "doctor", "--rig", "oven.yaml")
    assert code == 0, out + err
    assert re.search(rf"{stand.kind} \(plug-in\) +a backend of rigctl-{stand.kind} 0.1.0", out)
    assert re.search(rf"{re.escape(stand.port)} +oven: answers in", out)
    assert re.search(r"✓ temperature +20 degC", out)
    code, out, err = own_process.rigctl(stand.folder, "run", "step.yaml", "--json")
    assert code == 0, err
    answer = json.loads(out)
    assert (answer["status"], answer["records"]) == ("finished", 1)
    samples = open_run(Path(answer["path"])).samples(record=0)
    assert samples["temperature"].iloc[-1] > samples["temperature"].iloc[0] + 20.0
    assert samples["fan"].iloc[-1] == 50.0
    assert stand.device.outputs == {"heater": 0.0, "fan": 0.0}
    code, out, _ = own_process.rigctl(stand.folder, "runs", "show", "latest")
    assert code == 0
    assert re.search(rf"bench +kind {stand.kind}, name oven, port {re.escape(stand.port)}", out)


def trouble(stand: Stand) -> str:
    """What `doctor` says of the device that it cannot read; nothing else is wrong."""
    code, out, err = own_process.rigctl(stand.folder, "doctor", "--rig", "oven.yaml", "--json")
    assert code == 1, err
    (broken,) = [one for one in json.loads(out)["findings"] if one["state"] == "broken"]
    return str(broken["detail"])


def test_what_is_not_there_is_said_by_name(stand: Stand) -> None:
    stand.change(r"    timeout: .*", "    timeout: 1 s\n    wake: 10 s")
    good = stand.rig.read_text("utf-8")
    for old, new, said in WRONG[stand.kind]:
        assert good.count(old) == 1
        stand.rig.write_text(good.replace(old, new), encoding="utf-8")
        assert said in trouble(stand)
    stand.rig.write_text(good, encoding="utf-8")
    stand.change("    channels: {", "    chanels: {")
    code, _, err = own_process.rigctl(stand.folder, "check", "step.yaml")
    assert code == 2
    assert re.search(r"oven.yaml:\d+:5: unknown field, got 'chanels'; did you mean 'channels'", err)
    stand.rig.write_text(good.replace("{temperature: ", "{temperatur: "), encoding="utf-8")
    code, _, err = own_process.rigctl(stand.folder, "check", "step.yaml")
    assert code == 2
    assert "unknown channel, got 'temperatur'; did you mean 'temperature'" in err


def test_no_server_is_one_message(stand: Stand) -> None:
    stand.change(r"    timeout: .*", "    timeout: 1 s\n    wake: 10 s")
    stand.close()
    assert ABSENT[stand.kind] in trouble(stand)


def test_a_device_that_ends_ends_the_run_and_its_guard_makes_safe_what_comes_back(stand: Stand) -> None:
    stand.be_patient(silence="5 s")
    run = own_process.begin(stand.folder, "run", "step.yaml", "--json")
    stand.device.wait_for("heater", 1.0)
    stand.device.kill()
    out, err = run.communicate(timeout=600)
    assert run.returncode == 1, err
    answer = json.loads(out)
    assert answer["status"] == "failed"
    assert "heater on" in answer["unconfirmed"]
    # or it ended between a request and its answer
    assert re.search(f"{LOST[stand.kind]}|the device does not answer", answer["reason"])
    stand.device = stand.start("--on")
    stand.device.wait_for("heater", 0.0)


def test_an_output_that_does_something_else_ends_the_run(stand: Stand) -> None:
    stand.be_patient()
    steps = stand.folder / "step.yaml"
    steps.write_text(steps.read_text("utf-8").replace("fan: 50 %", "fan: 100 %"), encoding="utf-8")
    code, out, err = own_process.rigctl(stand.folder, "run", "step.yaml", "--json")
    assert code == 1, err
    assert OTHERWISE[stand.kind] in json.loads(out)["reason"]
    assert stand.device.outputs == {"heater": 0.0, "fan": 0.0}
