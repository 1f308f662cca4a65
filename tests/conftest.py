"""Fixtures of all tests: a separate state folder, and no guard of a device left running."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from filelock import FileLock
from hypothesis import HealthCheck, settings

from own_process import end_guards

# The examples of `make test` are the same each time and have no deadline; `make explore` looks for new ones,
# and what it finds is added as an `@example`.
# How fast examples are made is not judged either: on a busy machine that health check fails by itself.
_CHECKS = [HealthCheck.too_slow]
settings.register_profile(
    "suite", derandomize=True, deadline=None, max_examples=50, suppress_health_check=_CHECKS
)
settings.register_profile("explore", max_examples=2_000, deadline=None, suppress_health_check=_CHECKS)
settings.load_profile("suite")

# Processes started by the tests keep their bytecode even where a variable disables it: otherwise each command
# run as a separate process would compile this package again, 0.1 to 0.4 s of processor time.
if os.environ.pop("PYTHONDONTWRITEBYTECODE", None):
    sys.dont_write_bytecode = False

# The linear algebra library starts threads even for matrices of two hundred rows; on cores that other tests
# keep busy, they wait ten times as long as they compute. The library reads this variable on import, and
# processes started by the tests inherit it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# The workers of pytest-xdist keep all cores busy, so each integrates its records on one thread: two would
# take turns at the interpreter's lock, which costs some 15 % of the processor time of a diagnosis.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")

# A shell without job control starts background commands with Ctrl-C ignored, and `nohup` ignores the end of
# the terminal; processes started by the tests would inherit that, and neither would end them.
for _name in ("SIGINT", "SIGHUP"):
    _number = getattr(signal, _name, None)  # Windows has no SIGHUP
    if _number is not None and signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, signal.default_int_handler if _name == "SIGINT" else signal.SIG_DFL)

#: files that mostly wait, for a silence, a process or a board in real time: one worker starts with them while
#: the others compute. In the first one this process is both host and device: it comes before thousands of
#: tests have filled the memory, whose garbage collection would stop both for longer than a guard waits.
WAITING = (
    "backends/test_line_guard.py",
    "faults/test_unconfirmed_endings.py",
    "backends/contract/test_devices.py",
    "cli/test_line_device.py",
    "faults/test_board_in_real_time.py",
    "faults/test_host_faults.py",
    "learning/test_backends.py",
    "cli/test_off.py",
    "faults/test_lost_answers.py",
    "dataset/test_kill.py",
    "plugins/test_examples.py",
)

#: files that compute longest, roughly the longest first: they start at once, so that no worker is left with
#: one at the end. Of two computing workers, the one that runs the pages gets every second file: those that
#: repeat a page reuse its fits, and likewise for the demo and the tests that repeat it.
LONGEST = (
    "test_docs.py",
    "validation/test_expected_verdicts.py",
    "journeys/test_tables.py",
    "benches/test_journeys.py",
    "journeys/test_heater_board.py",
    "validation/test_work.py",
    "journeys/test_measured_inputs.py",
    "journeys/test_demo.py",
    "discovery/test_worn_guide.py",
    "journeys/test_learn.py",
    "engine/test_guards.py",
    "benches/test_round_trips.py",
    "journeys/test_diagnose.py",
    "noise/test_estimate.py",
    "web/test_workbench.py",
    "analysis/linear/test_size_scatter.py",
    "journeys/test_effects_of_the_model.py",
    "benches/test_stirred_jar.py",
    "analysis/search/test_refit.py",
    "analysis/test_moving_bench.py",
    "torture/test_endings.py",
    "analysis/test_fmu_rival.py",
    "journeys/test_own_effects.py",
    "learning/test_learn.py",
    "analysis/single_values/test_verdicts.py",
    "journeys/test_switch_times.py",
    "model/test_plant.py",
    "journeys/test_three_backends.py",
    "model/test_signature.py",
    "firmware/test_emulated_bench.py",
    "analysis/test_strong_effects.py",
    "design/test_journey.py",
    "dataset/importing/test_hostile_files.py",
    "journeys/test_bad_data.py",
    "faults/test_board_faults.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Deal the longest files to the workers; the others follow, to be stolen by the first idle worker.

    `--dist worksteal` gives each worker a run of as many tests as the others in the order collected.
    """
    here = Path(__file__).parent
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    by_file: dict[str, list[pytest.Item]] = {}
    for item in items:
        by_file.setdefault(Path(os.path.relpath(item.path, here)).as_posix(), []).append(item)
    dealt: list[list[pytest.Item]] = [[] for _ in range(workers)]
    for name in WAITING:
        dealt[-1] += by_file.pop(name, [])
    computing = dealt[:-1] or dealt
    for place, name in enumerate(LONGEST):
        computing[place % len(computing)] += by_file.pop(name, [])
    rest = [item for name in by_file for item in by_file[name]]
    share = -(-len(items) // workers)
    for hand in dealt:
        room = max(share - len(hand), 0)
        hand.extend(rest[:room])
        del rest[:room]
    items[:] = [item for hand in dealt for item in hand] + rest


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Keep objects that live to the end out of the garbage collector's search for cycles.

    These searches took a fifth of a worker's processor time until its first test, and a tenth afterwards; of
    that half is left, and most of it goes with a search after 10 000 new containers instead of 700.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.set_threshold(10_000)
        gc.enable()


@pytest.fixture(scope="module", autouse=True)
def state_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder of locks and of guards' notices; a guard whose notice is removed ends.

    One for each module, so that `doctor` reports only guards left by this module's tests.
    """
    folder = tmp_path_factory.mktemp("state")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(folder))
        patch.setenv("XDG_CONFIG_HOME", str(folder))  # of what a user has allowed; on Windows the next one
        patch.setenv("WIN_PD_OVERRIDE_LOCAL_APPDATA", str(folder))  # the same, on Windows
        yield folder
        end_guards(folder)
        wait_for_guards()


@pytest.fixture(scope="session", autouse=True)
def no_kept_results() -> Iterator[None]:
    """Each test computes its own results and reuses no fit of another test or of this computer's user."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RIGCTL_RESULTS", "off")
        yield


@pytest.fixture(scope="session", autouse=True)
def no_waiting_for_the_disk() -> Iterator[None]:
    """Files are not forced to the disk, which takes milliseconds each: no test takes the power away, and what
    a killed process has written is in the system's memory. A closed file is refused as before."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", os.fstat)
        yield


@pytest.fixture(scope="module")
def shared_results(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """For modules that run commands as users type them: fits are shared with the other such modules.

    Fits are found by content, including that of the code, and the folder is new. Not for tests that replace
    the fitting code, since such a replacement is not detected.
    """
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent  # which the workers have in common
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RIGCTL_RESULTS", str(folder / "kept-results"))
        yield folder / "kept-results"


@pytest.fixture(scope="session")
def built_site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site of the documentation where a checkout has it, built once for all processes of these tests."""
    root = Path(__file__).parents[1]
    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent
    done = shared / "site-is-built"
    with FileLock(shared / "site.lock"):
        if not done.exists():
            subprocess.run([sys.executable, root / "tools" / "make_site.py"], check=True)
            done.touch()
    return root / "build" / "site"


@pytest.fixture(scope="module")
def small_search() -> Iterator[None]:
    """Fewer rivals, candidates, values of each free number and draws: the same design, in seconds."""
    from rigctl.design import design, rivals, search

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "CANDIDATES", 12)
        patch.setattr(search, "SWEEPS", 1)
        patch.setattr(search, "VALUES", 2)
        patch.setattr(rivals, "MOST_RIVALS", 3)
        patch.setattr(design, "DRAWS", 20)
        yield


def wait_for_guards() -> None:
    """Let no guard that a test in this process has left to itself outlive the tests."""
    guard_port = sys.modules.get("rigctl.backends.transport.guard_port")
    for process in guard_port._GOING_ON if guard_port else ():
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:  # its notice is in another folder
            process.kill()
            process.wait()
