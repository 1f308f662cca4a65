"""`rigctl` as a process on the emulated board's port: killed, run twice, at the wrong speed, after a trip."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from board_emulation import Emulation
from board_workshop import with_driven_valve
from rigctl.dataset import open_run, verify
from rigctl.errors import ExitCode
from rigctl.files.shipped import shipped
from rigctl.rig import load_rig

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="simavr is packaged for Linux only")

#: the messages of a run that ended because the computer, and the emulated board with it, stalled for longer
#: than an interlock may be blind; and for how long a test starts such a run again, s: a computer with too
#: many tests at once emulates no board in real time before some of them have ended
STALLED, PATIENCE = "when its computer has stalled", 600.0

HEATING = """\
procedure: heating
rig: bench.yaml
steps:
  - record: {name: heating, rate: 100 Hz}
    do:
      - set: {heater: on}
      - wait: 1 h
finally:
  - set: {heater: off}
"""


LOOP = """\
procedure: loop
rig: bench.yaml
steps:
  - record: {name: heating, rate: 100 Hz}
    do:
      - set: {heater: on}
      - control: {actuator: relief_valve, channel: supply_pressure, to: 30 bar,
                  gain: 0.5, integral: 8 1/s, rate: 100 Hz, where: WHERE, for: 1 h}
finally:
  - set: {heater: off}
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    (tmp_path / "bench.yaml").write_text(bench_file(), encoding="utf-8")
    (tmp_path / "heating.yaml").write_text(HEATING, encoding="utf-8")
    return tmp_path


@pytest.fixture
def driven(project: Path) -> Iterator[Emulation]:
    """The bench with a proportional relief valve, on the board's PWM."""
    (project / "bench.yaml").write_text(with_driven_valve(bench_file()), encoding="utf-8")
    made = Emulation(load_rig(project / "bench.yaml"), project / "ttyRIG")
    yield made
    made.close()


def bench_file() -> str:
    text = shipped("rigs", "hl32-bench-uno.yaml").read_text(encoding="utf-8")
    return text.replace(
        "stale_after: 1 s", "stale_after: 5 s"
    )  # the computer that runs the tests may be busy


@pytest.fixture
def emulation(project: Path) -> Iterator[Emulation]:
    made = Emulation(load_rig(project / "bench.yaml"), project / "ttyRIG")
    yield made
    made.close()


def begin(project: Path, *arguments: str) -> subprocess.Popen[str]:
    home = str(project / "home")
    return subprocess.Popen(
        [sys.executable, "-m", "rigctl", *arguments],
        cwd=project,
        env={**os.environ, "XDG_STATE_HOME": home, "HOME": home},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def rigctl(project: Path, *arguments: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr; the command is repeated where the computer and its board stalled."""
    give_up = time.monotonic() + PATIENCE
    while True:
        with begin(project, *arguments) as process:
            out, err = process.communicate(timeout=600)
        if STALLED not in out + err or time.monotonic() > give_up:
            return process.returncode, out, err


@contextmanager
def recording(project: Path, emulation: Emulation, procedure: str) -> Iterator[subprocess.Popen[str]]:
    """A run that heats and has two seconds of samples on disk; killed at the end.

    Where the computer stalls, so does the board, and the run ends as it should: another one is started.
    """
    give_up = time.monotonic() + PATIENCE
    while time.monotonic() < give_up:
        with begin(project, "run", procedure, "--port", "ttyRIG") as process:
            try:
                while process.poll() is None:
                    if emulation.board.outputs[0] and recorded_bytes(project) > 20_000:
                        yield process
                        return
                    time.sleep(0.005)
                out, err = process.communicate()
                assert STALLED in out + err, (out, err)
            finally:
                process.kill()
    pytest.fail("the computer was never quiet enough to emulate a board in real time")


def recorded_bytes(project: Path) -> int:
    """The size of the newest run's journal."""
    journals = [folder / "samples.journal" for folder in sorted((project / "runs").glob("2*"))[-1:]]
    return sum(path.stat().st_size for path in journals if path.exists())


def switched_off(emulation: Emulation) -> None:
    """Wait until the heater is off."""
    while emulation.board.outputs[0]:
        time.sleep(0.005)


def test_a_host_that_is_killed_while_heating_leaves_outputs_off_and_its_data(
    project: Path, emulation: Emulation
) -> None:
    with recording(project, emulation, "heating.yaml") as process:
        process.kill()
        switched_off(emulation)
        assert emulation.switched[-1][0] - emulation.heard <= 2.1
    folder = max((project / "runs").glob("2*"))
    assert verify(folder).good
    samples = open_run(folder).samples()
    recorded = samples[samples["record"] == 0]["time"]
    assert recorded.iloc[-1] - recorded.iloc[0] > 1.0  # at most the last second is lost
    gaps = open_run(folder).events["kind"].eq("gap").sum()  # the computer stalled
    assert recorded.diff().gt(0.05).sum() <= gaps

    code, _, err = rigctl(project, "run", "heating.yaml", "--port", "ttyRIG", "--dry", "--json")
    assert code == ExitCode.DONE, err
    later = [one for one in (project / "runs").glob("2*") if one > folder]
    notes = [str(text) for one in later for text in open_run(one).events["message"]]
    assert any("host silent; cleared" in text for text in notes)


@pytest.mark.parametrize("where", ["board", "host"])
def test_a_host_that_is_killed_in_a_loop_leaves_outputs_off_and_its_data(
    project: Path, driven: Emulation, where: str
) -> None:
    """A loop on the board runs by itself; it must not outlive the host that watches its limits."""
    (project / "loop.yaml").write_text(LOOP.replace("WHERE", where), encoding="utf-8")
    with recording(project, driven, "loop.yaml") as process:
        process.kill()
        switched_off(driven)
        assert driven.switched[-1][0] - driven.heard <= 2.1
        while driven.board.avr.pwm != 0.0:  # the level follows the switches
            time.sleep(0.005)
    assert verify(max((project / "runs").glob("2*"))).good


def test_a_second_host_on_the_port_is_refused_and_switches_nothing(
    project: Path, emulation: Emulation
) -> None:
    import serial

    with serial.Serial(str(emulation.name), 115200, timeout=30, exclusive=True) as first:
        code, _, err = rigctl(project, "run", "heating.yaml", "--port", "ttyRIG")
        assert code != ExitCode.DONE
        assert "somebody else has this port open" in err
        first.write(b"MEAS:ALL?\n")
        assert first.readline().rstrip().split(b",")[4:] == [b"0", b"0", b"0"], "nothing was switched"
    assert rigctl(project, "run", "heating.yaml", "--port", "ttyRIG", "--dry")[0] == ExitCode.DONE


def test_a_wrong_baud_rate_is_reported_and_nothing_moves(project: Path, emulation: Emulation) -> None:
    text = (project / "bench.yaml").read_text(encoding="utf-8")
    (project / "bench.yaml").write_text(text.replace("baud: 115200", "baud: 57600"), encoding="utf-8")
    code, _, err = rigctl(project, "run", "heating.yaml", "--port", "ttyRIG")
    assert code == ExitCode.FAILED
    assert "nobody answers at 57600 baud; is it the port, its speed" in err
    assert emulation.board.outputs == (False, False, False)


def test_a_trip_is_cleared_only_by_an_explicit_command(project: Path, emulation: Emulation) -> None:
    emulation.board.avr.send(b"DIAG:HANG\n")
    while not emulation.board.avr.resets:
        time.sleep(0.01)
    code, _, err = rigctl(project, "run", "heating.yaml", "--port", "ttyRIG")
    assert code == ExitCode.FAILED
    assert "the board has tripped: restarted by the MCU watchdog" in err
    assert "rigctl off --clear-trips" in err
    bench = ("--rig", "bench.yaml", "--port", "ttyRIG")
    code, out, _ = rigctl(project, "off", *bench)
    assert code == ExitCode.DONE
    assert out.startswith("outputs are safe: heater off, valve neutral; the board has tripped: restarted")
    code, out, _ = rigctl(project, "off", *bench, "--clear-trips")
    assert code == ExitCode.DONE
    assert "restarted by the MCU watchdog; cleared" in out
    assert rigctl(project, "off", *bench)[1] == (
        "outputs are safe: heater off, valve neutral (read back from the bench)\n"
    )
