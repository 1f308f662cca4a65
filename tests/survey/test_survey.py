"""`rigctl survey` as a user calls it: runs of a pump whose gaps widen, and unusable runs."""

from __future__ import annotations

import json
from contextlib import chdir
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from junitparser import JUnitXml

import rigctl
from commands import answer, call, refusal, told
from rigctl.dataset import list_runs
from rigctl.errors import ExitCode, RigctlError
from rigctl.model import load_model
from rigctl.model.measured.hold_out import require_names
from rigctl.monitoring.survey import _picked, _require_condition, survey
from rigctl.tasks import Workers

FAMILY = """\
family: pump
inputs:
  pressure: {value: 150 bar}
parameters:
  delivery: {value: 8.5 l/min, bounds: [1 l/min, 50 l/min]}
  slip: {value: 0.005 l/(min*bar), bounds: [0 l/(min*bar), 0.1 l/(min*bar)]}
outputs:
  flow: {unit: l/min, formula: delivery - slip*pressure}
"""
RIG = """\
name: pump
model: families/pump.yaml
channels:
  pressure: {unit: bar, quantity: pressure}
  flow: {unit: l/min, quantity: flow}
"""
MODEL = """\
model: families/pump.yaml
rig: rigs/pump.yaml
parameters:
  delivery: {value: 8.5 l/min, fit: true}
  slip: {value: 0.005 l/(min*bar), fit: true}
"""
SHARED = ("--model", "models/pump.yaml", "--effects", "none", "--workers", "1")
#: number of runs, and the number after which the gaps begin to widen
RUNS, WIDEN = 30, 12
#: the run with an outlying slip
STUCK = 24


def _slip(run: int) -> float:
    return 0.005 + 0.0003 * max(0, run - WIDEN)


@pytest.fixture(scope="module")
def year(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with a run every second week; one scatters far, and one has another bench's column."""
    folder = tmp_path_factory.mktemp("year")
    for name, text in {"families": FAMILY, "rigs": RIG, "models": MODEL}.items():
        (folder / name).mkdir()
        (folder / name / "pump.yaml").write_text(text, encoding="utf-8")
    (folder / "rigctl.toml").write_text("", encoding="utf-8")
    draw = np.random.default_rng(1)
    with chdir(folder):
        for run in range(RUNS):
            slip = _slip(run) * (1.4 if run == STUCK else 1.0)
            level = 8.5 * (1.0 + 0.002 * draw.standard_normal())
            rows = ["time,pressure [bar],flow [l/min]"]
            for k in range(24):
                pressure = 120.0 + 20.0 * (k // 6)
                flow = level - slip * pressure + 0.01 * draw.standard_normal()
                stamp = np.datetime64("2026-01-05T08:00:00") + np.timedelta64(14 * 86_400 * run + k, "s")
                rows.append(f"{stamp},{pressure + 0.02 * draw.standard_normal():.4f},{flow:.5f}")
            Path("log.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
            told("import", "log.csv", "--rig", "rigs/pump.yaml")
    return folder


def _one(found: dict[str, Any], name: str) -> dict[str, Any]:
    return next(one for one in found["quantities"] if one["name"] == name)


def test_a_growing_parameter_is_reported_with_its_size_and_date(year: Path) -> None:
    with chdir(year):
        found = answer("survey", *SHARED)
    assert (found["verdict"], found["over"]) == ("changed", "date")
    (change,) = found["changes"]
    assert (change["quantity"], change["kind"]) == ("slip", "growth")
    assert change["before"] == pytest.approx(0.005, abs=0.0003)
    assert change["after"] == pytest.approx(_slip(RUNS - 1), abs=0.0003)
    labels = [run["run"] for run in found["runs"]]
    assert WIDEN < labels.index(change["first_sure"]) < RUNS
    assert _one(found, "slip")["apart"] == [labels[STUCK]]
    assert _one(found, "delivery")["p_value"] > 0.01


def test_an_alarm_sets_the_exit_code_and_fails_a_junit_case(year: Path) -> None:
    with chdir(year):
        done = call("survey", *SHARED, "--alarm", "--junit", "s.xml", "--force", "-o", "s.html")
        assert done.exit_code == 1, done.output
        (suite,) = JUnitXml.fromfile("s.xml")
        page = Path("s.html").read_text(encoding="utf-8")
        lines = done.stdout.splitlines()
    assert (suite.tests, suite.failures, suite.errors) == (2, 1, 0)
    assert [case.name for case in suite if case.result] == ["slip"]
    assert lines[0].startswith("Changed: slip grew from ")
    assert any(line.startswith("  the model   agrees with ") and f" of {RUNS} runs" in line for line in lines)
    assert any(line.startswith("  outliers ") and line.endswith("(slip)") for line in lines)
    assert len(lines) <= 8 and "scatter between runs" not in done.stdout
    assert "Changed." in page and "course-1" in page and "<script src" not in page


def test_notes_on_the_data_equal_those_of_compare(year: Path) -> None:
    with chdir(year):
        ids = [run.id for run in list_runs()][:3]
        notes = [run["notes"] for run in answer("survey", *ids, *SHARED)["runs"]]
        compared = answer("compare", ids[0], "--model", "models/pump.yaml")["notes"]
        evidence = told("survey", *ids, *SHARED, "-v")
    assert compared and notes[0] == compared
    assert all(note in evidence for each in notes for note in each)


def test_an_effect_is_tested_in_its_typical_shape() -> None:
    model = load_model(Path(__file__).parents[2] / "models" / "hl32-textbook.yaml")
    found = {one.name: one for one in _picked(model, None, None)}
    assert not found["coulomb_friction"].shapes and not found["stribeck_friction"].shapes
    sizes = found["pump_slip"].parameter("pump_slip.conductance").grid
    assert list(found["pump_slip"].secants.values()) == [sorted(sizes)[len(sizes) // 2]]


def test_no_change_is_reported_before_the_parameter_changes(year: Path) -> None:
    with chdir(year):
        ids = [run.id for run in list_runs()][: WIDEN + 1]
        found = answer("survey", *ids, *SHARED, "--alarm")
    assert found["changes"] == []
    assert found["verdict"] in ("cannot_tell", "no_change_seen")


def test_one_or_two_runs_give_no_verdict(year: Path) -> None:
    with chdir(year):
        ids = [run.id for run in list_runs()]
        for few in ([ids[0]], [ids[0], ids[-1]]):
            found = answer("survey", *few, *SHARED)
            assert found["verdict"] == "cannot_tell"
            assert "0 quantities" not in found["statement"]
            assert _one(found, "slip")["p_value"] is None
            assert _one(found, "slip")["between_runs"] is None
        evidence = told("survey", *few, *SHARED, "-v")
    assert "scatter between runs" in evidence and all(run in evidence for run in few)


def test_a_run_with_excluded_records_is_named_and_left_out(year: Path) -> None:
    with chdir(year):
        ids = [run.id for run in list_runs()]
        told("runs", "exclude", ids[5], "0", "--reason", "air in the line")
        try:
            found = answer("survey", *SHARED)
        finally:
            told("runs", "exclude", ids[5], "0", "--reason", "none was", "--undo")
    failed = {run["run"]: run["failed"] for run in found["runs"] if "failed" in run}
    assert list(failed) == [ids[5]] and "excluded" in failed[ids[5]]
    assert found["verdict"] == "changed"
    assert len(_one(found, "slip")["values"]) == RUNS - 1


def test_a_damaged_run_is_named_and_left_out(year: Path) -> None:
    with chdir(year):
        last = list_runs()[-1]
        file = Path(str(last.folder)) / "run.json"
        whole = file.read_text("utf-8")
        try:
            file.write_text(whole.replace("finished", "finishing"), encoding="utf-8")
            found = answer("survey", *SHARED)
            alone = refusal("survey", last.id, *SHARED, exit_code=ExitCode.FAILED)
        finally:
            file.write_text(whole, encoding="utf-8")
    assert len(found["runs"]) == RUNS - 1
    assert any(last.id in note for note in found["notes"])
    assert last.id in alone


def test_runs_in_storage_give_the_same_answer(year: Path) -> None:
    with chdir(year):
        ids = [run.id for run in list_runs()][:3]
        stored = [f"{(year / 'runs').as_uri()}/{name}" for name in ids]
        here, there = (answer("survey", *named, *SHARED) for named in (ids, stored))
    assert here == there


def test_the_answer_does_not_depend_on_the_number_of_workers(year: Path) -> None:
    with chdir(year):
        model, runs = rigctl.load_model("models/pump.yaml"), [rigctl.open_run(r.id) for r in list_runs()]
        one, two = (
            survey(runs, model, effects=["none"], workers=Workers(count)).document() for count in (1, 2)
        )
    assert json.dumps(one) == json.dumps(two)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--over", "oil_hour"), "oil_hour"),
        (("--by", "colour"), "colour"),
        (("--share", "slop"), "slip"),
        (("--effects", "none", "--share", "thinning"), "thinning"),
        (("--where", "rig = 'other'"), "no run to survey"),
    ],
)
def test_unknown_names_are_refused_with_the_nearest_one(
    year: Path, options: tuple[str, ...], says: str
) -> None:
    with chdir(year):
        assert says in refusal("survey", *SHARED, *options)


def test_a_condition_with_an_unknown_name_is_refused_before_any_run_is_read(
    year: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A misspelt name was refused once the measurements of every run had been read."""
    for read in ("without_copies", "measured", "fit_problem", "read_entry"):
        monkeypatch.setattr(f"rigctl.monitoring.survey.{read}", None)
    with chdir(year):
        assert "did you mean 'record'" in refusal("survey", *SHARED, "--only", "recrod > 1")


def test_a_damaged_run_does_not_prevent_a_condition(year: Path) -> None:
    """Its columns are not known, and the others are surveyed without it."""

    class Damaged:
        layout = SimpleNamespace(channels=(), commands=())

        @property
        def records(self) -> Any:
            raise RigctlError("the file is damaged")

    model = load_model(year / "models" / "pump.yaml")
    runs: Any = [Damaged()]
    require_names("rod > 1", model, runs)


def test_a_condition_is_refused_only_if_no_run_knows_its_names(monkeypatch: pytest.MonkeyPatch) -> None:
    """A rod that only the sixth run has was unknown."""
    known: list[str] = []

    def check(_: Any, condition: str, names: Any) -> None:
        if condition not in names:
            raise RigctlError("unknown name", value=condition)

    def measured(_: Any, runs: Any) -> Any:
        known.append(runs)
        return SimpleNamespace(measurements=runs)

    monkeypatch.setattr("rigctl.monitoring.survey.measured", measured)
    monkeypatch.setattr("rigctl.monitoring.survey.check_condition", check)
    monkeypatch.setattr("rigctl.monitoring.survey.variable_units", lambda names: names)
    entries: Any = [SimpleNamespace(runs=runs) for runs in [("speed",)] * 6 + [("speed", "rod"), ("speed",)]]
    plan: Any = None
    _require_condition(plan, entries, "rod")
    assert len(known) == 7  # the rest need not be asked
    with pytest.raises(RigctlError, match="unknown name"):
        _require_condition(plan, entries, "rot")


def test_a_shared_parameter_is_held_and_still_tested(year: Path) -> None:
    with chdir(year):
        found = answer("survey", *SHARED, "--share", "delivery", "--over", "pressure", "--by", "month")
    assert (found["free"], found["shared"]) == (["slip"], ["delivery"])
    assert {one["kind"] for one in found["quantities"]} == {"parameter", "held"}


def test_a_run_of_another_bench_is_refused(year: Path) -> None:
    fan = RIG.replace("name: pump", "name: fan").replace("model: families/pump.yaml\n", "")
    with chdir(year):
        Path("rigs/fan.yaml").write_text(fan.replace("flow:", "draught:"), encoding="utf-8")
        Path("fan.csv").write_text("time [s],draught [l/min]\n" + "".join(f"{k},1\n" for k in range(9)))
        run = json.loads(told("import", "fan.csv", "--rig", "rigs/fan.yaml", "--json"))["run"]
        try:
            said = refusal("survey", run, *SHARED, exit_code=ExitCode.FAILED)
        finally:
            for file in sorted((year / "runs").glob(f"**/{run}/*")):
                file.unlink()
    assert "draught" in said or "fan" in said


def test_a_file_that_was_imported_twice_counts_once(year: Path) -> None:
    with chdir(year):
        before = list_runs()[-1].id
        again = json.loads(told("import", "log.csv", "--rig", "rigs/pump.yaml", "--json"))["run"]
        try:
            found = answer("survey", before, again, *SHARED)
            compared = answer("compare", before, again, "--model", "models/pump.yaml")
        finally:
            for file in sorted((year / "runs").glob(f"**/{again}/*")):
                file.unlink()
    assert [run["run"] for run in found["runs"]] == [again]
    assert any(before in note and again in note for note in found["notes"])
    assert any(before in note and again in note for note in compared["notes"])
