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

KINDS = [pytest.param(kind, marks=needs_package(f"rigctl_{kind}")) for kind in ("epics", "mqtt")]
#: what a rig file calls the heater's output, and something there that holds no number
HEATER = {"epics": "OVEN:HEATER", "mqtt": "oven/heater/set"}
TEMPERATURE = {"epics": "OVEN:TEMPERATURE", "mqtt": "oven/temperature"}
LABEL = {"epics": "OVEN:LABEL", "mqtt": "oven/label"}


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
