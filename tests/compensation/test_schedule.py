"""A set-point schedule on the simulated bench: solved, checked by records in pairs, accepted or not."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterator
from contextlib import chdir
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from commands import MODEL, answer, call, create_project, refusal, told
from rigctl.compensation.schedule import compensate
from rigctl.dataset import open_run
from rigctl.errors import RigctlError
from rigctl.model import load_model

pytestmark = pytest.mark.usefixtures("shared_results")

#: hidden in the bench: the flow-control valve closes as it warms, so the stroke decreases
HIDDEN = "flow_area_thermal_drift"
WANTED = ("--keep", "stroke = 95 mm", "--vary", "supply_pressure", "--over", "oil_temperature")


@pytest.fixture(scope="module")
def bench(shared_results: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A campaign on a bench that drifts with its oil, and the model with that effect fitted to it."""
    folder = tmp_path_factory.mktemp("compensation")
    create_project(folder)
    with chdir(folder):
        arguments = ("temperatures=30 degC, 60 degC", "pressures=20 bar, 45 bar")
        words = [word for argument in arguments for word in ("-a", argument)]
        run = answer("simulate", "procedures/campaign.yaml", *words, "--with", HIDDEN, "--seed", "4")["run"]
        told("model", "add", MODEL, HIDDEN, run)
        yield run


@pytest.fixture(scope="module")
def schedule(bench: str) -> dict[str, Any]:
    files = ("schedule.h", "schedule.csv", "procedures/check.yaml", "check.yaml")
    outputs = [word for file in files for word in ("-o", file)]
    return answer("compensate", bench, "--model", MODEL, *WANTED, "--rows", "4", *outputs)


def test_the_scheduled_pressure_rises_with_the_temperature_and_keeps_the_stroke(
    schedule: dict[str, Any],
) -> None:
    rows = schedule["rows"]
    assert [row["over"] for row in rows] == pytest.approx([30.0, 40.0, 50.0, 60.0], abs=0.5)
    assert all(0.2 < after["vary"] - before["vary"] < 1.0 for before, after in pairwise(rows))
    for row in rows:
        assert row["kept"] == pytest.approx(95.0, abs=1e-3)
        assert 0.0 < row["std"] < 0.1
        assert 0.0 < row["scatter"] < 1.0
    assert rows[0]["fixed"] > 95.3
    assert rows[-1]["fixed"] < 94.7
    assert schedule["interpolation_error"] < 0.05
    assert {one["name"]: (one["low"], one["high"]) for one in schedule["valid"]}["supply_pressure"] == (
        20.0,
        45.0,
    )
    assert "95 mm" in schedule["statement"]


def test_the_answer_is_short_and_the_table_needs_verbose(bench: str, schedule: dict[str, Any]) -> None:
    asked = ("compensate", bench, "--model", MODEL, *WANTED, "--rows", "4")
    lines = told(*asked).splitlines()
    assert lines[0] == f"Schedule: {schedule['statement']}."
    (points,) = [line for line in lines if line.startswith("  set ")]
    assert points.count(" bar at ") == len(schedule["rows"])
    assert "at constant" not in "\n".join(lines[1:])
    assert "at constant" in "\n".join(told(*asked, "-v").splitlines()[1:])


def test_the_csv_and_the_c_header_contain_the_schedule(schedule: dict[str, Any]) -> None:
    with Path("schedule.csv").open(encoding="utf-8", newline="") as stream:
        heads, *lines = csv.reader(stream)
    assert heads[:2] == ["oil_temperature [degC]", "supply_pressure [bar]"]
    wanted = [row["vary"] for row in schedule["rows"]]
    assert [float(line[1]) for line in lines] == pytest.approx(wanted, rel=1e-4)
    header = Path("schedule.h").read_text("utf-8")
    (numbers,) = re.findall(r"_set\[4\] = \{(.*?)\};", header)
    assert [float(one.removesuffix("f")) for one in numbers.split(", ")] == pytest.approx(wanted, rel=1e-4)
    assert all("." in one for one in numbers.split(", "))
    assert "bar over oil_temperature in degC" in header


def test_the_check_procedure_has_pairs_in_random_order(schedule: dict[str, Any]) -> None:
    for file, called in (("procedures/check.yaml", "stroke.yaml"), ("check.yaml", "procedures/stroke.yaml")):
        assert f'procedure: "{called}"' in Path(file).read_text("utf-8")
        assert answer("check", file)["kind"] == "procedure"
    order = re.findall(r"pair: \[(\d+)\], compensated: \[(\d)\]", schedule["procedure"])
    assert [pair for pair, _ in order] == [str(1 + k // 2) for k in range(16)]
    assert all(
        {one, other} == {"0", "1"} for (_, one), (_, other) in zip(order[::2], order[1::2], strict=True)
    )
    assert {first for _, first in order[::2]} == {"0", "1"}
    refusal("compensate", "latest", "--model", MODEL, *WANTED, "-o", "schedule.h")  # it is there


def test_a_schedule_is_accepted_only_on_the_bench_that_drifts(schedule: dict[str, Any]) -> None:
    assert schedule["procedure"]
    told("simulate", "procedures/check.yaml", "--with", HIDDEN, "--seed", "5")
    verdict = answer("compensate", "latest", "--judge")
    assert verdict["accepted"]
    assert verdict["pairs"] == 8
    assert verdict["error_with"] < 0.4 < verdict["error_without"]
    assert verdict["ratio"] < verdict["bound"] < 1.0
    assert "Accepted" in told("compensate", "latest", "--judge")
    told("simulate", "procedures/check.yaml", "--seed", "6")
    done = call("compensate", "latest", "--judge", "--json")
    assert done.exit_code == 1
    assert not json.loads(done.stdout)["accepted"]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"--keep": "strok = 95 mm"}, "did you mean 'stroke'"),
        ({"--keep": "stroke = 95 bar"}, "another dimension"),
        ({"--keep": "95 mm"}, "not a target"),
        ({"--keep": "noise_position = 1 mm"}, "no record"),
        ({"--keep": "stroke = 300 mm"}, "does not reach"),
        ({"--vary": "suply_pressure"}, "did you mean 'supply_pressure'"),
        ({"--vary": "oil_temperature", "--over": "supply_pressure"}, "no set-point"),
        ({"--over": "supply_pressure"}, "are the same"),
    ],
)
def test_invalid_requests_are_refused_with_their_reason(
    bench: str, changed: dict[str, str], said: str
) -> None:
    wanted = dict(zip(WANTED[::2], WANTED[1::2], strict=True)) | changed
    words = [word for pair in wanted.items() for word in pair]
    assert said in refusal("compensate", bench, "--model", MODEL, *words)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"--keep": "stroke = 95 bar"}, "another dimension"),
        ({"--vary": "suply_pressure"}, "did you mean 'supply_pressure'"),
        ({"--over": "position"}, "unknown quantity of the operating point for --over"),
    ],
)
def test_a_wrong_option_is_refused_before_the_fit(bench: str, changed: dict[str, str], said: str) -> None:
    wanted = dict(zip(WANTED[::2], WANTED[1::2], strict=True)) | changed
    options = {name.removeprefix("--"): value for name, value in wanted.items()}
    done: list[str] = []
    with pytest.raises(RigctlError, match=said):
        compensate([open_run(bench)], load_model(MODEL), **options, on_progress=done.append)  # type: ignore[arg-type]
    assert done == []


def test_the_schedule_ends_where_the_rig_reaches_its_limit(bench: str) -> None:
    words = ("--keep", "stroke = 127 mm", *WANTED[2:], "--rows", "3")
    found = answer("compensate", bench, "--model", MODEL, *words, "--page", "schedule.html")
    reached = [row["vary"] is not None for row in found["rows"]]
    assert reached == sorted(reached, reverse=True)
    assert any(reached)
    assert not all(reached)
    (end,) = found["ends"]
    last = max(row["over"] for row in found["rows"] if row["vary"] is not None)
    (at,) = re.findall(r"^it ends at oil_temperature ([\d.]+) degC;", end)
    assert last < float(at) < last + 15.0
    assert "its highest, stroke is 12" in end
    page = Path("schedule.html").read_text("utf-8")
    assert "A set-point schedule" in page
    assert "out of reach" in page
    assert "It ends at oil temperature" in page
    assert any("extrapolated" in note for note in found["notes"])


def test_other_runs_and_incomplete_options_are_refused(bench: str) -> None:
    assert "no check of a schedule" in refusal("compensate", bench, "--judge")
    assert "--over" in refusal("compensate", bench, "--keep", "stroke = 95 mm")
    assert "from its records" in refusal("compensate", bench, "--judge", "--vary", "supply_pressure")
    with pytest.raises(RigctlError, match="not a file format for a schedule"):
        told("compensate", bench, "--model", MODEL, *WANTED, "-o", "schedule.txt")


def test_an_actuator_without_influence_is_refused_as_set_point(tmp_path: Path) -> None:
    create_project(tmp_path)
    with chdir(tmp_path):
        arguments = ("powers=20 %, 60 %", "second=30 %", "dwell=1 min")
        words = [word for argument in arguments for word in ("-a", argument)]
        told("simulate", "procedures/heater-board-steps.yaml", *words, "--seed", "3")
        wanted = ("--keep", "final = 40 degC", "--vary", "heater_2", "--over", "heater_1")
        model = ("--model", "models/heater-board.yaml")  # without coupling of the two heaters
        assert "does not change 'final'" in refusal("compensate", "latest", *model, *wanted)


def test_a_run_without_measures_is_refused_before_a_fit(tmp_path: Path) -> None:
    create_project(tmp_path)
    with chdir(tmp_path):
        told("import", "data/unknown-bench.csv", "--rig", "rigs/hl32-bench.yaml")
        said = refusal("compensate", "latest", "--model", MODEL, *WANTED)
    assert "took no measure" in said
    assert "a 'measure' step" in said
