"""A recording played as a bench."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from rigctl.backends.errors import BackendLost
from rigctl.backends.protocol import Sample
from rigctl.backends.registry import create_backend
from rigctl.backends.replay.player import Player
from rigctl.backends.replay.recording import Recording, continuous_time
from rigctl.backends.simulated.bench import SimulatedBench
from rigctl.clock import VirtualClock
from rigctl.dataset import RunHeader, RunWriter, Source, source_of_rig
from rigctl.errors import ExitCode, RigctlError
from rigctl.rig import Rig, parse_rig

STARTED = datetime(2026, 11, 21, 12, tzinfo=UTC)


def recording(count: int = 2500, step: float = 0.01) -> Recording:
    times = np.arange(count) * step
    values = np.column_stack([300.0 + times, 20e5 + times, 0.01 * times])
    values[count // 3, 2] = np.nan
    return Recording(times, values, np.column_stack([times > 1.0, times > 2.0, times * 0.0 + np.nan]))


def player(rig: Rig, played: Recording) -> Player:
    bench = Player(rig, VirtualClock(), lambda: played, {"run": "20261121-120000-stroke"})
    bench.open()
    return bench


def test_samples_are_played_at_their_recorded_intervals(rig: Rig) -> None:
    played = recording()
    bench = player(rig, played)
    assert bench.next_sample(3.0) is None
    bench.start(10.0)
    taken = []
    for k in range(len(played.times)):
        if k == 1000:
            bench.start(50.0)
        sample = bench.next_sample(1.0)
        assert sample
        taken.append(sample)
    assert [sample.time for sample in taken] == (3.0 + played.times).tolist()
    assert np.array_equal([sample.values for sample in taken], played.values, equal_nan=True)
    assert np.array_equal([sample.commands for sample in taken], played.commands, equal_nan=True)
    assert math.isnan(taken[2500 // 3].values[2])


def test_the_end_of_the_recording_is_reported_as_an_error(rig: Rig) -> None:
    bench = player(rig, recording(3))
    bench.start(100.0)
    for _ in range(3):
        assert bench.next_sample(1.0)
    assert bench.next_sample(0.1) is None  # the last step of the procedure may still come to its end
    with pytest.raises(BackendLost, match=r"the recording ended at 0\.02 s") as problem:
        bench.next_sample(1.0)
    assert problem.value.exit_code == ExitCode.FAILED
    assert bench.clock.now() == pytest.approx(0.02 + 0.5 * rig.stale_after)
    bench.close()
    bench.close()
    with pytest.raises(BackendLost, match="not open"):
        bench.safe()


def test_a_gap_in_the_recording_is_replayed_as_a_gap(rig: Rig) -> None:
    played = recording(4)
    played.times[2:] += 5.0
    bench = player(rig, played)
    bench.start(100.0)
    results = [bench.next_sample(2.0) for _ in range(6)]
    assert [sample and round(sample.time, 3) for sample in results] == [0.0, 0.01, None, None, 5.02, 5.03]


def test_commands_get_receipts_and_leave_the_recorded_samples_unchanged(rig: Rig) -> None:
    bench = player(rig, recording())
    bench.start(100.0)
    bench.next_sample(1.0)
    assert bench.command("valve", 1.0, duration=0.055).wait().time == 0.0
    bench.command("heater", 1.0, duration=0.02).wait()
    for _ in range(5):
        bench.next_sample(1.0)
    assert [(r.time, r.actuator, r.value) for r in bench.take_receipts()] == [(0.02, "heater", 0.0)]
    sample = bench.next_sample(1.0)
    assert sample
    assert sample.commands[:2] == (0.0, 0.0)
    assert [(r.time, r.actuator, r.value) for r in bench.take_receipts()] == [(0.055, "valve", 0.0)]
    bench.command("valve", 1.0, duration=0.1).wait()
    bench.safe()
    for _ in range(20):
        bench.next_sample(1.0)
    assert bench.take_receipts() == []
    assert bench.take_notices() == []


def test_records_that_each_start_at_zero_follow_one_another() -> None:
    times = np.array([0.0, 0.1, 0.2, 0.0, 0.1, 0.2, 0.2, 0.3])
    assert continuous_time(times) == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.5, 0.6])
    assert len(continuous_time(np.array([]))) == 0


def record_a_run(rig: Rig, runs: Path, bench: SimulatedBench, samples: int) -> list[Sample]:
    """A run on disk, as the runner would write it."""
    header = RunHeader("20261121-120000-stroke", Source("stroke"), source_of_rig(rig), rig.layout, STARTED)
    writer = RunWriter.create(runs, header)
    bench.start(100.0)
    bench.command("valve", 1.0, duration=0.505).wait()
    taken = []
    for _ in range(samples):
        sample = bench.next_sample(1.0)
        assert sample
        taken.append(sample)
        writer.append((sample.time, -1.0, *sample.values, *sample.commands))
    writer.close("finished")
    return taken


def test_a_recorded_run_is_replayed_sample_by_sample(
    rig: Rig, tmp_path: Path, make_bench: Callable[..., SimulatedBench]
) -> None:
    bench = make_bench(noise="on", quantised="on", faults="sensor_noisy:position@0.5 s")
    recorded = record_a_run(rig, tmp_path, bench, 120)
    again = create_backend(rig, "replay", VirtualClock(), {"run": "latest", "runs": tmp_path})
    assert again.identity == {"kind": "replay", "name": "HL32 bench", "run": "20261121-120000-stroke"}
    again.open()
    again.start(100.0)
    for before in recorded:
        sample = again.next_sample(1.0)
        assert sample
        assert sample.time == pytest.approx(before.time, abs=1e-12)
        assert sample.values == pytest.approx(before.values, rel=1e-12)
        assert sample.commands == pytest.approx(before.commands, rel=1e-12)
    with pytest.raises(BackendLost, match="the recording ended"):
        again.next_sample(1.0)


def test_a_rig_with_another_channel_cannot_play_the_run(
    rig: Rig, tmp_path: Path, make_bench: Callable[..., SimulatedBench]
) -> None:
    record_a_run(rig, tmp_path, make_bench(), 3)
    other = parse_rig(rig.text.replace("supply_pressure", "suply_pressure"))
    bench = create_backend(other, "replay", VirtualClock(), {"run": "2026", "runs": tmp_path})
    with pytest.raises(RigctlError) as problem:
        bench.open()
    assert "has no channel 'suply_pressure'" in str(problem.value)
    assert problem.value.nearest == "supply_pressure"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "which run is to be played?"),
        ({"run": ""}, "which run is to be played?"),
        ({"rnu": "latest"}, "did you mean 'run'?"),
        ({"run": "20200101-000000-nothing"}, "20200101-000000-nothing"),
    ],
)
def test_a_replay_without_an_existing_run_is_refused(
    rig: Rig, tmp_path: Path, options: dict[str, str], message: str
) -> None:
    with pytest.raises(RigctlError) as problem:
        create_backend(rig, "replay", VirtualClock(), {"runs": tmp_path, **options})
    assert message in str(problem.value)


def test_replaying_never_imports_the_engine(
    rig: Rig, tmp_path: Path, make_bench: Callable[..., SimulatedBench]
) -> None:
    record_a_run(rig, tmp_path, make_bench(), 3)
    code = (
        "import sys; from pathlib import Path; from rigctl.clock import VirtualClock;"
        "from rigctl.rig import load_rig; from rigctl.backends.registry import create_backend;"
        f"b = create_backend(load_rig(Path({str(rig.path)!r})), 'replay', VirtualClock(),"
        f" {{'run': 'latest', 'runs': {str(tmp_path)!r}}});"
        "b.open(); b.start(10.0); b.next_sample(1.0);"
        "names = ('rigctl.engine', 'rigctl.model', 'rigctl.physics', 'rigctl.effects', 'numba');"
        "print([n for n in names if n in sys.modules])"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "[]"
