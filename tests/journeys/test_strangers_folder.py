"""A stranger's project, full of Python files named like everything that rigctl imports, executes none."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from websockets.sync.client import connect
from websockets.typing import Origin

import rigctl as rigctl_package
from commands import create_strokes
from own_process import RIGCTL
from rigctl.child_process import isolated_children, module_command
from systems import own_state
from web.serving import serving
from web.watched import wait_for

#: a module that says where it was executed
TRAP = "import pathlib\npathlib.Path({witness!r}, __name__).touch()\n"


@pytest.fixture(scope="module")
def traps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with a run, and beside its files a module of every name of this Python and its packages."""
    project = create_strokes(tmp_path_factory.mktemp("stranger") / "project", "30 degC", seed=7)
    (project / "executed").mkdir()
    installed = {name for name in packages_distributions() if name.isidentifier()}
    for name in {*sys.stdlib_module_names, *installed, "rigctl", "sitecustomize", "usercustomize"}:
        text = TRAP.format(witness=str(project / "executed"))
        (project / f"{name}.py").write_text(text, encoding="utf-8")
    (project / "rigctl").mkdir()
    for name in ("__init__", "__main__"):
        text = TRAP.format(witness=str(project / "executed"))
        (project / "rigctl" / f"{name}.py").write_text(text, encoding="utf-8")
    return project


@pytest.fixture
def nothing_executed(traps: Path) -> Iterator[Callable[[], list[str]]]:
    def executed() -> list[str]:
        return sorted(path.name for path in (traps / "executed").iterdir())

    assert executed() == []
    yield executed
    assert executed() == []


def rigctl(folder: Path, *arguments: str, **variables: str) -> str:
    done = subprocess.run(
        [*RIGCTL, *arguments],
        cwd=folder,
        env={**os.environ, **own_state(folder / "state"), **variables},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stderr


@pytest.mark.usefixtures("nothing_executed")
def test_commands_with_other_processes_execute_no_file_of_the_project(traps: Path) -> None:
    """A page for a run, and the reader of a foreign format."""
    from openpyxl import Workbook

    told = rigctl(traps, "simulate", "procedures/quick-check.yaml", "--speed", "max", "--serve")
    assert "Shown at http" in told
    book = Workbook()
    for row in (("time [s]", "position [mm]"), *((0.1 * k, float(k)) for k in range(50))):
        book.active.append(row)
    book.save(traps / "x.xlsx")
    rigctl(traps, "import", "x.xlsx", "--rig", "rigs/hl32-bench.yaml")


@pytest.mark.usefixtures("nothing_executed")
def test_the_pages_of_a_project_execute_no_file_of_it(traps: Path, tmp_path: Path) -> None:
    """Started from elsewhere, too, every process of a page works in the project's folder."""
    with serving(traps, "--port", "0", state=tmp_path) as served:
        cookie = served.enter()
        start = {"path": "procedures/quick-check.yaml", "bench": "simulated", "speed": "max"}
        status, told = served.post("/api/procedure/start", start, cookie)
        assert status == 200, told
        (run, *_) = served.get("/api/runs", cookie)["runs"]
        assert served.post("/api/report", {"runs": [run["id"]]}, cookie)[0] == 200
        wait_for(lambda: not served.get("/api/status", cookie)["working"])
        address = f"ws://{served.host}/api/workbench/session"
        with connect(address, origin=Origin(served.base), additional_headers={"Cookie": cookie}) as socket:
            socket.send('{"do": "fly"}')
            assert socket.recv(60)


@pytest.mark.parametrize(
    "module",
    [
        "rigctl.fmu.worker",
        "rigctl.backends.transport.guard",
        "rigctl.dataset.importing.formats.foreign",
    ],
)
@pytest.mark.usefixtures("nothing_executed")
def test_a_module_in_another_process_is_the_installed_one(traps: Path, module: str) -> None:
    """Without its arguments each ends at once, after its imports."""
    command = module_command(f"rigctl.{module}")
    subprocess.run(command, cwd=traps, input=b"", capture_output=True, timeout=120, check=False)


POOL = """
import os, sys
from rigctl.tasks.pools import in_processes
if __name__ == "__main__":
    os.chdir(sys.argv[1])
    print([result for _, result in in_processes(abs, [-1], 1)])
"""


@pytest.mark.usefixtures("nothing_executed")
def test_workers_of_a_script_execute_no_file_of_the_working_folder(traps: Path, tmp_path: Path) -> None:
    """And the script's own processes afterwards have the environment that they had before."""
    script = tmp_path / "script.py"
    script.write_text(POOL, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, script, traps], capture_output=True, text=True, timeout=120, check=True
    )
    assert done.stdout == "[1]\n"


@pytest.mark.usefixtures("nothing_executed")
def test_no_entry_of_pythonpath_leads_into_the_folder_of_another_process(
    traps: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An empty entry, which a trailing colon leaves, means the working folder of each process."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep + "nowhere")
    with isolated_children():
        command = module_command("rigctl.dataset.importing.formats.foreign")
        subprocess.run(command, cwd=traps, input=b"", capture_output=True, timeout=120, check=False)
        assert os.environ["PYTHONPATH"] == str(Path.cwd() / "nowhere")
    assert os.environ["PYTHONPATH"] == os.pathsep + "nowhere"


def test_no_module_starts_python_in_another_way() -> None:
    """Every other process of this Python is started by `rigctl.child_process`, or by `multiprocessing`."""
    source = Path(rigctl_package.__file__).parent
    found = {path.name for path in source.rglob("*.py") if "sys.executable" in path.read_text("utf-8")}
    assert found == {"child_process.py"}
