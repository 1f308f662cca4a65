"""Output that nobody reads blocks neither a run nor its end."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
import typer

from rigctl.cli.attended_run import report_end
from rigctl.cli.nonblocking_output import Outlet, carry_out
from rigctl.errors import ExitCode
from rigctl.runner.session import RunResult

STEPS = "procedure: p\nrig: rigs/heater-board.yaml\nsteps:\n  - set: {heater_1: 60 %}\n  - wait: WAIT s\n"


def simulate(folder: Path, *arguments: str, out: int, err: int) -> int:
    (folder / "rigctl.toml").write_text("", encoding="utf-8")
    (folder / "p.yaml").write_text(STEPS.replace("WAIT", "1"), encoding="utf-8")
    command = [sys.executable, "-m", "rigctl", "simulate", "p.yaml", *arguments]
    return subprocess.run(
        command, cwd=folder, stdin=subprocess.DEVNULL, stdout=out, stderr=err, timeout=600, check=False
    ).returncode


def status(folder: Path) -> str:
    (run,) = (folder / "runs").glob("2*")
    return str(json.loads((run / "run.json").read_text(encoding="utf-8"))["status"])


@pytest.mark.skipif(sys.platform == "win32", reason="a pipe without waiting is POSIX")
@pytest.mark.parametrize("speed", ["max", "10x"])
def test_a_run_ends_and_exits_although_its_output_is_not_read(tmp_path: Path, speed: str) -> None:
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with pytest.raises(BlockingIOError):
        while True:
            os.write(writer, b"x" * 4096)
    os.set_blocking(writer, True)
    try:
        assert simulate(tmp_path, "--speed", speed, out=writer, err=writer) == 0
    finally:
        os.close(writer)
        os.close(reader)
    assert status(tmp_path) == "finished"


def test_an_undeliverable_answer_is_a_failure(tmp_path: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        assert simulate(tmp_path, "--json", out=writer, err=subprocess.DEVNULL) == 141
    finally:
        os.close(writer)
    assert status(tmp_path) == "finished"


@pytest.mark.parametrize("call", ["--help", "effects", "schema rig", "runs list", "check p.yaml"])
def test_a_reader_that_closes_the_pipe_ends_a_command_without_a_message(tmp_path: Path, call: str) -> None:
    """`rigctl effects | head` used to exit with 1, and `rigctl --help | true` with a traceback."""
    (tmp_path / "p.yaml").write_text(STEPS.replace("WAIT", "1"), encoding="utf-8")
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "rigctl", *call.split()],
            cwd=tmp_path,
            stdout=writer,
            stderr=subprocess.PIPE,
            text=True,
            timeout=600,
            check=False,
        )
    finally:
        os.close(writer)
    assert (done.returncode, done.stderr) == (141, "")


def test_a_mistake_keeps_its_exit_status_although_nobody_reads_it(tmp_path: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        command = [sys.executable, "-m", "rigctl", "check", "nowhere.yaml"]
        assert subprocess.run(command, cwd=tmp_path, stderr=writer, timeout=600, check=False).returncode == 2
    finally:
        os.close(writer)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_output_to_a_full_device_is_a_failure_with_a_message(tmp_path: Path) -> None:
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        command = [sys.executable, "-m", "rigctl", "effects"]
        done = subprocess.run(
            command, cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True, timeout=600, check=False
        )
    assert (done.returncode, done.stderr) == (1, "rigctl: No space left on device\n")


class Stuck:
    """A stream that blocks on its first text until released."""

    encoding = "utf-8"

    def __init__(self) -> None:
        self.go_on = threading.Event()
        self.took: list[str] = []

    def write(self, text: str) -> int:
        self.go_on.wait(30.0)
        self.took.append(text)
        return len(text)

    def flush(self) -> None: ...


def test_a_full_queue_keeps_the_newest_output_in_order() -> None:
    stream = Stuck()
    outlet = Outlet(stream)  # type: ignore[arg-type]
    for number in range(300):
        print(f"{number} " * 2000, file=outlet)
    assert not outlet.drain(0.0)
    stream.go_on.set()
    assert outlet.drain(30.0)
    said = "".join(stream.took)
    assert said.endswith("299 " * 2000 + "\n")
    assert (
        len(said) < 2 * (1 << 20) + 10_000
    )  # what the thread took at once, and a full queue, of 2.3 million
    numbers = [int(word) for word in said.split()]
    assert numbers == sorted(numbers)


class Terminal:
    """Two streams of one terminal; the display's is slow."""

    encoding = "utf-8"

    def __init__(self, shown: list[str], results: threading.Event, *, slow: bool) -> None:
        self._shown, self._results, self._slow = shown, results, slow

    def write(self, text: str) -> int:
        if self._slow:
            self._results.wait(1.0)
        else:
            self._results.set()
        self._shown.append(text)
        return len(text)

    def flush(self) -> None: ...

    def fileno(self) -> int:
        raise io.UnsupportedOperation("no file")


def test_the_last_frame_of_the_display_does_not_erase_the_results(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawn later by another thread, it used to erase the line that states how the run ended."""
    shown: list[str] = []
    results = threading.Event()
    monkeypatch.setattr(sys, "stdout", Terminal(shown, results, slow=False))
    monkeypatch.setattr(sys, "stderr", Terminal(shown, results, slow=True))

    def work() -> None:
        sys.stderr.write("picture")
        report_end(RunResult("finished", None, ExitCode.DONE, None, 1, 2.0), as_json=False)

    with pytest.raises(typer.Exit):
        carry_out(work)
    assert shown[0] == "picture"
    assert "finished" in shown[1]


def test_ctrl_c_at_the_very_end_leaves_no_traceback() -> None:
    """The third of three Ctrl-C used to end `rigctl run` with a traceback."""
    code = (
        "import sys\nfrom rigctl.cli import entry, main\n"
        "def stopped():\n    try:\n        sys.exit(130)\n"
        "    except SystemExit:\n        raise KeyboardInterrupt\n"
        "main.main = stopped\nsys.argv = ['rigctl', 'run']\nentry.main()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")
