"""FMUs of other tools: a motor as a Python class, which PythonFMU wraps in its own library."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from commands import answer
from fmu.motor_bench import write_bench
from systems import needs_compiler

pytestmark = needs_compiler

SLAVE = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Motor(Fmi2Slave):
    def __init__(self, **arguments):
        super().__init__(**arguments)
        self.voltage = self.speed = self.current = 0.0
        self.R, self.k, self.b = 1.8, 0.045, 2e-4
        self.register_variable(Real("voltage", causality=Fmi2Causality.input))
        for name in ("speed", "current"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))
        for name in ("R", "k", "b"):
            kind = Fmi2Variability.tunable
            self.register_variable(Real(name, causality=Fmi2Causality.parameter, variability=kind))

    def rates(self, current, speed):
        return (
            (self.voltage - self.R * current - self.k * speed) / 20e-3,
            (self.k * current - self.b * speed) / 2e-4,
        )

    def do_step(self, time, step):
        count = max(1, round(step / 1e-3))
        h = step / count
        for _ in range(count):
            a = self.rates(self.current, self.speed)
            b = self.rates(self.current + 0.5 * h * a[0], self.speed + 0.5 * h * a[1])
            c = self.rates(self.current + 0.5 * h * b[0], self.speed + 0.5 * h * b[1])
            d = self.rates(self.current + h * c[0], self.speed + h * c[1])
            self.current += h / 6.0 * (a[0] + 2.0 * b[0] + 2.0 * c[0] + d[0])
            self.speed += h / 6.0 * (a[1] + 2.0 * b[1] + 2.0 * c[1] + d[1])
        return True
"""


@pytest.fixture(autouse=True)
def motor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The run of the bench whose resistance rises in the course of a record, and its FMU beside it."""
    monkeypatch.chdir(tmp_path)
    run = write_bench(tmp_path, resistance=lambda time, volts, winding: 2.0 + 0.8 * time)
    (tmp_path / "motor_slave.py").write_text(SLAVE, encoding="utf-8")
    subprocess.run([sys.executable, "-m", "pythonfmu", "build", "-f", "motor_slave.py"], check=True)
    (tmp_path / "Motor.fmu").replace(tmp_path / "motor.fmu")
    return run


def test_what_is_missing_inside_it_is_found(motor: str) -> None:
    model = ("--model", "model.yaml", "--family", "motor.fmu")
    assert not answer("compare", motor, *model)["models"][0]["adequate"]
    found = answer("diagnose", motor, *model, "--max-effects", "1")
    assert (found["verdict"], found["effects"]) == ("ambiguous", ["drift_of_resistance_in_time"])
    rate = found["ranking"][0]["parameters"]["rate"]
    assert rate["value"] == pytest.approx(0.8, abs=3.0 * rate["std"])
    assert rate["std"] < 0.08


def test_its_files_are_drafted(motor: str) -> None:
    drafted = answer("family", "new", "drive", "--fmu", "motor.fmu", "--csv", "log.csv")
    roles = {one["name"]: one["role"] for one in drafted["columns"]}
    assert roles == {"voltage": "input", "current": "output", "speed": "output", "winding": "left out"}
    assert "gives no unit for" in " ".join(drafted["notes"])
