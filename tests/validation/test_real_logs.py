"""The tier of real logs: how they are prepared, how the answers are counted, and a cheap part of it."""

from __future__ import annotations

import json
import lzma
import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.real.prepare import LOGS as PREPARED
from benchmarks.real.prepare import emps, silverbox
from scipy.io import savemat

from commands import refusal
from rigctl.effects.generic.offer import generic_effects
from rigctl.errors import RigctlError
from rigctl.model.load import load_model
from rigctl_validation.outcome import Improved, TrialOutcome, Verdict
from rigctl_validation.real.logs import FOLDER_VARIABLE, LOGS, data_folder, find_log
from rigctl_validation.real.rates import real_figures
from rigctl_validation.real.tables import training_lines, unseen_lines, write_lines
from rigctl_validation.real.trial import RealTrial, real_trials
from rigctl_validation.real.work import RealOutcome, carry_out_real
from rigctl_validation.tables import page


@pytest.fixture
def published(tmp_path: Path) -> Path:
    """A folder with files in the forms in which the logs are published; the numbers are made up."""
    source = tmp_path / "downloads"
    source.mkdir()
    rng = np.random.default_rng(0)
    for name, rows in (("dryer", 510), ("damper", 2010)):
        savemat(source / f"{name}.mat", {"X": rng.random((1, rows)), "y": rng.random((1, rows))})
    savemat(source / "drive.mat", {f"{key}{k}": rng.random((30, 1)) for key in "uz" for k in (1, 2, 3)})
    for name in ("fixedStepSequence", "randomStepSequence"):
        time = 0.02 * np.arange(100)
        savemat(source / f"{name}.mat", {"time": time, "u": rng.random(100), "y": rng.random(100)})
    for bar in (1, 3, 5, 7):
        np.savetxt(source / f"O-ring257_{bar}bar.csv", rng.random((41, 7)), fmt="%.3f", delimiter="\t")
    rows = "\n".join(f"{u:.6f},{y:.6f}," for u, y in rng.random((127_400, 2)))
    (source / "SNLS80mV.csv").write_text(f'"V1","V2",\n{rows}\n', encoding="utf-8")
    for name in ("DATA_EMPS", "DATA_EMPS_PULSES"):
        columns = {key: rng.random((205, 1)) for key in ("t", "vir", "qm")}
        savemat(source / f"{name}.mat", columns)
    return source


def test_the_published_files_become_tables_that_the_tier_reads(published: Path, tmp_path: Path) -> None:
    out = tmp_path / "data"
    for prepare in PREPARED.values():
        prepare(published, out)
    for log in LOGS.values():
        lines, unseen = training_lines(log, out), unseen_lines(log, out)
        assert len(lines) > 1
        assert log.fit or unseen.keys() == log.known.keys()
        widths = {line.count(",") for each in (lines, *unseen.values()) for line in each}
        assert len(widths) == 1
    assert len(training_lines(find_log("dryer"), out)) == 501
    assert len(unseen_lines(find_log("damper"), out)["last 1499 rows"]) == 11
    assert training_lines(find_log("hoop"), out)[2].startswith("0.1,")  # every fifth of 50 Hz
    assert [line.split(",")[1] for line in training_lines(find_log("oring"), out)].count("p5") == 5
    assert len(unseen_lines(find_log("silverbox"), out)["arrow"]) == 40_001


def test_the_voltage_of_the_positioning_system_is_the_mean_until_the_next_reading(
    published: Path, tmp_path: Path
) -> None:
    time = 1e-3 * np.arange(20)
    savemat(published / "DATA_EMPS.mat", {"t": time, "vir": np.arange(20.0), "qm": 1e-3 * np.arange(20.0)})
    emps(published, tmp_path / "data")
    lines = training_lines(find_log("emps"), tmp_path / "data")
    assert lines == ["time [s],voltage [V],position [mm]", "0,4.5,0", "0.01,14.5,10"]


def test_a_silverbox_file_is_read_compressed_or_not(published: Path, tmp_path: Path) -> None:
    silverbox(published, tmp_path / "data")
    packed = tmp_path / "data" / "silverbox" / "SNLS80mV.csv.xz"
    lines = training_lines(find_log("silverbox"), tmp_path / "data")
    packed.with_suffix("").write_bytes(lzma.decompress(packed.read_bytes()))
    packed.unlink()
    assert training_lines(find_log("silverbox"), tmp_path / "data") == lines


def test_a_log_is_cut_to_its_first_rows(tmp_path: Path) -> None:
    write_lines(tmp_path / "log.csv", ["a,b", "1,2", "3,4", "5,6"], rows=2)
    assert (tmp_path / "log.csv").read_text(encoding="utf-8") == "a,b\n1,2\n3,4\n"


@pytest.mark.parametrize("name", list(LOGS))
def test_every_log_has_the_files_of_its_user(name: str) -> None:
    model = load_model(LOGS[name].file("model.yaml"))
    assert {output.name for output in model.family.outputs} >= {LOGS[name].channel}
    assert generic_effects(model.family)


def test_without_the_logs_the_command_says_where_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(FOLDER_VARIABLE, raising=False)
    said = refusal("validate", "--tier", "real")
    assert FOLDER_VARIABLE in said
    assert "benchmarks/real/README.md" in said


def test_a_missing_file_of_a_log_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    for log in LOGS.values():
        with pytest.raises(RigctlError, match="real logs is missing"):
            training_lines(log, data_folder())


def outcome(log: str, verdict: Verdict, *effects: str, rows: int = 0, **more: object) -> RealOutcome:
    return replace(TrialOutcome(RealTrial(log, rows), verdict=verdict, effects=effects), **more)


def counts(outcomes: Iterable[RealOutcome]) -> dict[str, tuple[int, int]]:
    found = real_figures(tuple(outcomes))
    json.dumps(found.document(), allow_nan=False)
    assert page(found, "rigctl validate --tier real")
    return {f"{rate.name}, {rate.of}": (rate.count, rate.trials) for rate in found.rates}


def test_wrong_verdicts_on_real_logs_are_counted() -> None:
    found = counts([
        outcome("silverbox", "missing_effect", "cubic_stiffness_on_slope"),
        outcome("hoop", "ambiguous", "gain_of_voltage", classes=(("gain_of_voltage", "lag_of_speed"),)),
        outcome("dryer", "missing_effect", "drift_of_thermocouple"),
        outcome("oring", "adequate", rows=100),
        outcome("oring", "outside_library"),
        outcome("ced", "undecided"),
    ])  # fmt: skip
    assert found["wrong green, every length"] == (1, 6)
    assert found["wrong name, every length"] == (1, 6)
    assert found["right, or its class, whole logs"] == (2, 5)
    assert found["not decided, every length"] == (1, 6)
    assert found["opposite claims, logs, over their lengths"] == (1, 5)


def test_errors_of_unseen_parts_are_compared_with_the_best_known() -> None:
    better = Improved(
        ("a",), {"output": 0.1}, {"multisine 10": 7.0, "arrow": 14.0}, {"multisine 10": 0.52, "arrow": 2.0}
    )
    worse = Improved(("b",), {"force": None}, {"last 1499 rows": 35.0}, {"last 1499 rows": 42.0})
    failed = replace(worse, after={"last 1499 rows": float("nan")})
    found = counts([
        outcome("silverbox", "missing_effect", "cubic_stiffness_on_slope", improved=better),
        outcome("damper", "missing_effect", "quadratic_of_velocity", improved=worse),
        outcome("damper", "missing_effect", "quadratic_of_velocity", rows=100, improved=failed),
    ])  # fmt: skip
    assert found["the best known error reached, unseen parts, within 20%"] == (1, 3)
    assert found["what is unseen became worse, every length"] == (2, 3)


def test_an_outcome_survives_json() -> None:
    improved = Improved(("a",), {"force": 0.5}, {"last 1499 rows": 35.0}, {"last 1499 rows": 9.0}, "adequate")
    one = outcome("damper", "missing_effect", "a", improved=improved)
    assert TrialOutcome.read(json.loads(json.dumps(one.document())), RealTrial.read) == one


def test_every_log_comes_whole_before_it_is_cut() -> None:
    trials = real_trials()
    assert [trial.log for trial in trials[: len(LOGS)]] == list(LOGS)
    assert not any(trial.rows for trial in trials[: len(LOGS)])
    assert len({trial.name for trial in trials}) == len(trials)
    assert RealTrial("dryer", 1000) not in trials  # it has 500 rows


@pytest.mark.parametrize("trial", [RealTrial("dryer", 300)], ids=lambda trial: trial.name)
def test_a_cut_log_is_never_adequate_and_gets_no_wrong_name(trial: RealTrial) -> None:
    if not os.environ.get(FOLDER_VARIABLE):
        pytest.skip(
            f"{FOLDER_VARIABLE} names no folder of real logs: benchmarks/real/README.md has their sources"
        )
    done = carry_out_real(trial)
    found = counts([done])
    assert found["wrong green, every length"] == (0, 1)
    assert found["wrong name, every length"] == (0, 1)
    assert found["what is unseen became worse, every length"] == (0, 1)
