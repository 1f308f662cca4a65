"""What a PC with Windows has: mapped drives, files that are held, long paths, names without case."""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from commands import MODEL, call, create_strokes, refusal, told
from own_process import rigctl
from patience import patient
from rigctl.cli.commands.init import create_project
from rigctl.dataset import open_run
from rigctl.errors import ExitCode
from rigctl.files.regular import read_text
from rigctl.files.shipped import shipped
from systems import needs_posix, own_state
from tclab_board import Served

HEATING = """\
procedure: heating
rig: board.yaml
steps:
  - set: {heater_1: 60 %}
  - wait: 4 s
  - set: {heater_1: 0 %}
"""
#: starts rigctl and waits for it, as a shell or an editor does
PARENT = "import subprocess, sys; subprocess.run([sys.executable, '-P', '-m', 'rigctl', *sys.argv[1:]])"


@pytest.fixture(scope="module")
def strokes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return create_strokes(tmp_path_factory.mktemp("strokes") / "bench", "[40 degC]", seed=3)


@pytest.fixture
def bench(strokes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(shutil.copytree(strokes, tmp_path / "bench"))
    return tmp_path / "bench"


@contextmanager
def held(path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The file is open in another program, unshared: really so on Windows, elsewhere by its error."""
    if sys.platform == "win32":
        kernel = ctypes.WinDLL("kernel32", use_last_error=True)
        kernel.CreateFileW.restype = ctypes.c_void_p
        kernel.CloseHandle.argtypes = (ctypes.c_void_p,)
        handle = kernel.CreateFileW(str(path), 0x80000000, 0, None, 3, 0, None)  # to read, unshared, existing
        assert handle not in (None, ctypes.c_void_p(-1).value), ctypes.get_last_error()
        try:
            yield
        finally:
            kernel.CloseHandle(handle)
    else:
        replace = Path.replace

        def refused(self: Path, target: str | Path) -> Path:
            if Path(target).absolute() == path.absolute():
                problem = PermissionError(13, "The process cannot access the file")
                problem.winerror = 32  # type: ignore[attr-defined] # of Windows only
                raise problem
            return replace(self, target)

        with monkeypatch.context() as patched:
            patched.setattr(Path, "replace", refused)
            yield


def test_a_table_that_a_spreadsheet_holds_is_one_message_and_can_be_written_later(
    bench: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told("export", "latest", "-o", "out.csv")
    Path("out.csv").write_text("opened\n", encoding="utf-8")
    with held(bench / "out.csv", monkeypatch):
        message = refusal("export", "latest", "-o", "out.csv", "--force", exit_code=ExitCode.FAILED)
        assert "out.csv" in message
        assert "If another program has it open, as a spreadsheet may, close it there" in message
    assert Path("out.csv").read_text(encoding="utf-8") == "opened\n"
    assert [one.name for one in bench.glob("*.tmp")] == []
    told("export", "latest", "-o", "out.csv", "--force")
    assert Path("out.csv").read_text(encoding="utf-8").startswith("time")


@needs_posix("links that anybody may make, in the place of a drive")
def test_a_project_on_a_mapped_drive_keeps_the_names_of_the_drive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    r"""There the working folder is R:\bench, and what it resolves to is \\server\share\bench."""
    share, drive = tmp_path / "server" / "share", tmp_path / "R"
    share.mkdir(parents=True)
    drive.symlink_to(share, target_is_directory=True)
    create_project(drive / "bench")
    monkeypatch.chdir(drive / "bench")
    monkeypatch.setattr(os, "getcwd", lambda: str(drive / "bench"))
    for line in (
        "check procedures/quick-check.yaml",
        "simulate procedures/quick-check.yaml --seed 1",
        "runs list",
        "runs show latest",
        "export latest -o out.csv",
        f"export {drive / 'bench' / 'runs'}/2*quick-check -o out.xlsx",
        f"model add {MODEL} piston_leakage --fit latest",
        f"model history {drive / 'bench' / MODEL}",
        f"model diff {MODEL}@1 {MODEL}",
        "runs verify latest",
    ):
        words = [word for written in line.split() for word in _found(written)]
        done = call(*words)
        assert done.exit_code == 0, (line, done.output, done.exception)
        assert str(share) not in done.output, line


def _found(word: str) -> list[str]:
    """The files that a pattern of a shell means; of Windows' shells none does this."""
    pattern = Path(word)
    return [str(one) for one in pattern.parent.glob(pattern.name)] if "*" in word else [word]


def test_a_name_in_another_case_is_the_same_file_where_the_system_says_so(bench: Path) -> None:
    other = "models/HL32-TEXTBOOK.yaml"
    if Path(other).exists():
        assert "version 1 of 1" in told("model", "history", other)
        told("model", "add", other, "piston_leakage", "--fit", "latest")
        assert "version 2 of 2" in told("model", "history", MODEL)
        names = [one.name.casefold() for one in bench.joinpath("models").iterdir()]
        assert len(names) == len(set(names))
    else:
        assert f"did you mean '{MODEL}'?" in refusal("model", "history", other)


def test_a_path_of_more_than_260_characters_is_used_or_refused_in_one_message(bench: Path) -> None:
    deep = bench.joinpath(*["d" * 40] * 6)
    assert len(str(deep / "out.csv")) > 260
    code, out, err = rigctl(bench, "export", "latest", "-o", str(deep / "out.csv"))
    assert (code, out) == (0, f"{(deep / 'out.csv').as_posix()}: {_rows()} rows\n") or code == 1
    assert "Traceback" not in err
    assert len(err.splitlines()) <= 1
    assert (deep / "out.csv").exists() is (code == 0)


def _rows() -> int:
    return len(open_run(next(Path("runs").glob("2*"))).table("samples")["time"])


def test_the_page_is_opened_in_the_user_s_browser(tmp_path: Path) -> None:
    """The browser is a program that copies the page it is given, and the page leads to the address."""
    project, copy = tmp_path / "bench", tmp_path / "shows.py"
    create_project(project)
    copy.write_text(
        "import sys, urllib.request as web\n"
        "text = web.urlopen(sys.argv[1]).read()\n"
        "open(sys.argv[2] + '.part', 'wb').write(text)\n"
        "import os; os.replace(sys.argv[2] + '.part', sys.argv[2])\n",
        encoding="utf-8",
    )
    program = f'"{Path(sys.executable).as_posix()}" "{copy.as_posix()}" %s "{(tmp_path / "seen").as_posix()}"'
    screen = {"BROWSER": program, "DISPLAY": ":0", "PYTHONUNBUFFERED": "1"}
    served = subprocess.Popen(
        [sys.executable, "-P", "-m", "rigctl", "serve", str(project), "--port", "0"],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8",
        env={**os.environ, **own_state(tmp_path / "state"), **screen},
    )  # fmt: skip
    opened = _waited(lambda: (tmp_path / "seen").exists() or served.poll() is not None)
    served.terminate()
    out, err = served.communicate()
    assert opened, (out, err)
    address = next(word for word in out.split() if word.startswith("http://"))
    assert f'content="0; url={address}"' in (tmp_path / "seen").read_text(encoding="utf-8"), err


def test_a_run_goes_on_to_its_end_when_the_program_that_started_it_is_ended(tmp_path: Path) -> None:
    (tmp_path / "rigctl.toml").write_text("", encoding="utf-8")
    (tmp_path / "heating.yaml").write_text(HEATING, encoding="utf-8")
    text = shipped("rigs", "tclab-board.yaml").read_text(encoding="utf-8")
    (tmp_path / "board.yaml").write_text(patient(text), encoding="utf-8")
    with Served() as board:
        parent = subprocess.Popen(
            [sys.executable, "-c", PARENT, "run", "heating.yaml", "--port", board.url],
            cwd=tmp_path, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env={**os.environ, **own_state(tmp_path / "state")},
        )  # fmt: skip
        try:
            assert _waited(lambda: board.sketch.heaters == (60.0, 0.0) or parent.poll() is not None)
            assert parent.poll() is None, parent.communicate()
        finally:
            parent.kill()
            parent.wait()
        parent.stdout.close()  # type: ignore[union-attr] # nobody reads what the run prints
        parent.stderr.close()  # type: ignore[union-attr]
        (run,) = (tmp_path / "runs").glob("2*")
        assert _waited(lambda: _info(run)["status"] != "running")
        assert board.sketch.heaters == (0.0, 0.0)
    assert _info(run)["status"] == "finished"


def _info(run: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(read_text(run / "run.json"))  # it may just be replaced
    return document


def test_powershell_gets_a_script_that_completes_the_command(tmp_path: Path) -> None:
    """As with `--install-completion` in PowerShell, where the shell is found by itself."""
    done = subprocess.run(
        [sys.executable, "-P", "-m", "rigctl", "--show-completion", "powershell"],
        cwd=tmp_path, capture_output=True, encoding="utf-8", check=False,
        env={**os.environ, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert "Register-ArgumentCompleter -Native -CommandName" in done.stdout
    assert 'complete_powershell"' in done.stdout


def _waited(condition: Callable[[], object]) -> bool:
    """Wait for it, as long as a busy computer may take; whether it came."""
    give_up = time.monotonic() + 240.0
    while not condition():
        if time.monotonic() > give_up:
            return False
        time.sleep(0.02)
    return True
