"""`rigctl family new --fmu`: the files drafted from what an FMU says of itself, by whole commands."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

import pytest

from commands import answer, refusal, told
from fmu.motor_bench import fitted, write_bench
from foreign_fmus import lag_fmu, motor_fmu
from rigctl.files.yaml import read_document
from systems import needs_compiler

pytestmark = needs_compiler


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def described(path: Path, changes: Mapping[str, str]) -> None:
    """Change the description of an FMU in place, and take its program's code away: it can only be read."""
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    about = parts["modelDescription.xml"].decode()
    for old, new in changes.items():
        assert old in about
        about = about.replace(old, new)
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, about if name.endswith(".xml") else content[:0])


def lag(version: str, units: tuple[str, str], *, names: tuple[str, str] = ("u", "y"), spin: str = "") -> None:
    """Write lag.fmu, which names its units without a definition, but of `spin`."""
    named = "".join(f'<Unit name="{unit}"/>' for unit in units if unit and unit != "spin")
    lag_fmu(Path("lag.fmu"), version, "CoSimulation", names=names, units=units, defined=named + spin)


def family(name: str = "drive") -> dict[str, dict[str, dict[str, str]]]:
    return read_document(Path(f"families/{name}.yaml")).data  # type: ignore[return-value]


def log(text: str) -> None:
    rows = "\n".join(f"{0.1 * k:.1f},{1 if k > 9 else 0},{0.1 * k * k:.3f},{k % 7}" for k in range(40))
    Path("log.csv").write_text(f"{text}\n{rows}\n", encoding="utf-8")


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_its_draft_fits_the_log_as_it_is(tmp_path: Path, version: str) -> None:
    write_bench(tmp_path, version=version)
    drafted = answer("family", "new", "drive", "--fmu", "motor.fmu", "--csv", "log.csv")
    assert (drafted["fmu"], drafted["template"], drafted["fit"]["outputs"]) == ("motor.fmu", None, {})
    roles = {one["name"]: (one["role"], one["origin"]) for one in drafted["columns"]}
    assert roles == {
        "voltage": ("input", "commanded"),
        "current": ("output", None),
        "speed": ("output", None),
    }
    assert family()["parameters"]["r"] == {
        "variable": "R",
        "value": "1.8 Ohm",
        "bounds": ["0.0018 Ohm", "1800 Ohm"],
    }
    for command in drafted["next"]:
        told(*command.split()[1:])
    found = answer("compare", "latest", "--model", "models/drive.yaml", "--family", "motor.fmu")
    assert found["models"][0]["adequate"], found
    truth = {"r": 2.0, "k": 0.05, "b": 1e-4, "j": 2e-4, "l": 20e-3}
    assert fitted(found).keys() == truth.keys()
    for name, (value, std) in fitted(found).items():
        assert value == pytest.approx(truth[name], abs=4.0 * std)


def test_its_bounds_and_meanings_are_kept_and_nothing_of_it_is_executed(tmp_path: Path) -> None:
    motor_fmu(tmp_path / "motor.fmu")
    described(
        tmp_path / "motor.fmu",
        {
            'start="1.8" unit="Ohm"': 'start="1.8" unit="Ohm" min="0.5" max="9"',
            'name="k" ': 'name="k" description="torque: per current" ',
            'start="2e-4" unit="N.m.s/rad"': 'start="0" min="0" unit="N.m.s/rad"',
            'start="20e-3" unit="H"': 'start="INF" unit="H"',
        },
    )
    drafted = answer("family", "new", "drive", "--fmu", "motor.fmu")
    parameters = family()["parameters"]
    assert parameters["r"]["bounds"] == ["0.5 Ohm", "9 Ohm"]
    assert parameters["k"]["meaning"] == "torque: per current"
    assert parameters["b"]["bounds"] == ["0 N*m*s/rad", "1 N*m*s/rad"]
    assert "l" not in parameters
    said = "\n".join(drafted["notes"])
    assert "motor.fmu gives no number for L: left out" in said
    assert (
        "motor.fmu gives 0 for b, and not both bounds: fixed until you write bounds in families/drive" in said
    )
    assert "motor.fmu does not bound k, J on both sides" in said
    assert "motor.fmu does not say which change of speed, current matters" in said
    model = Path("models/drive.yaml").read_text(encoding="utf-8")
    assert "b: {value: 0 N*m*s/rad, fit: false}" in model
    assert "r: {value: 1.8 Ohm, fit: true}" in model


def test_units_that_it_does_not_give_are_said() -> None:
    spin = '<Unit name="spin"><BaseUnit rad="1" s="-1" factor="0.10471975511965977"/></Unit>'
    lag("2.0", ("furlong_", "spin"), spin=spin)
    drafted = answer("family", "new", "drive", "--fmu", "lag.fmu")
    assert "inputs" not in family()
    assert family()["outputs"]["y"]["unit"] == "s^-1*rad"
    said = "\n".join(drafted["notes"])
    assert "lag.fmu has units that are not known, and does not define them: u (furlong_); left out" in said
    assert "lag.fmu gives no unit for T, limit: drafted as plain numbers" in said


def test_columns_are_matched_by_the_nearest_name_and_said() -> None:
    lag("2.0", ("", "Pa"), names=("Demand", "pressure"))
    log("t [s],demand,presure [bar],other [V]")
    drafted = answer("family", "new", "drive", "--fmu", "lag.fmu", "--csv", "log.csv")
    reasons = {one["name"]: one["reason"] for one in drafted["columns"]}
    assert reasons["demand"].startswith("Demand of lag.fmu")
    assert reasons["presure"] == "pressure of lag.fmu, the nearest name"
    assert reasons["other"] == "lag.fmu has no input or output of a similar name"
    assert family()["outputs"] == {"presure": {"variable": "pressure", "unit": "Pa", "scale": "1.521 bar"}}


def test_a_unit_is_taken_from_where_it_is_known() -> None:
    lag("3.0", ("V", ""), names=("u", "speed"))
    log("t [s],u,speed [rpm],other [V]")
    drafted = answer("family", "new", "drive", "--fmu", "lag.fmu", "--csv", "log.csv")
    assert family()["outputs"]["speed"]["unit"] == "rad/s"
    said = "\n".join(drafted["notes"])
    assert "lag.fmu gives no unit for speed: taken for SI" in said
    assert "The log states no unit for u: taken for those of lag.fmu; --unit says otherwise" in said
    assert {one["name"]: one["unit"] for one in drafted["columns"]} == {
        "u": "V",
        "speed": "rpm",
        "other": "V",
    }
    for command in drafted["next"][:1]:
        told(*command.split()[1:])


def test_a_column_of_another_name_is_stated() -> None:
    lag("2.0", ("", "V"))
    log("t [s],command,Sensor 2 [V],other [A]")
    draft = ("family", "new", "drive", "--fmu", "lag.fmu", "--csv", "log.csv")
    said = refusal(*draft)
    assert "no column has the name of an output of lag.fmu" in said
    assert '--variable "COLUMN=y" says which column is y' in said
    drafted = answer(*draft, "--variable", "Sensor 2=y")
    assert family()["outputs"]["sensor_2"]["variable"] == "y"
    assert "No column is the input u: constant, at the value in families/drive.yaml" in drafted["notes"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--template", "motor"), "--fmu and --template exclude each other"),
        (("--output", "y"), "--fmu and --output exclude each other"),
        (("--variable", "other=z"), "unknown --variable: input or output of lag.fmu, got 'z'"),
        (("--variable", "other=y"), "the column other has another dimension than y of lag.fmu, got 'A'"),
    ],
    ids=["template", "roles", "variable", "dimension"],
)
def test_a_contradiction_is_one_message(options: tuple[str, str], said: str) -> None:
    lag("2.0", ("", "V"))
    log("t [s],u,thing,other [A]")
    assert said in refusal("family", "new", "drive", "--fmu", "lag.fmu", "--csv", "log.csv", *options)
    assert not Path("families").exists()


def test_variables_need_an_fmu() -> None:
    assert "expected --fmu FILE" in refusal("family", "new", "a", "--template", "motor", "--variable", "a=b")


@pytest.mark.parametrize("command", [("list",), ("list", "--slots"), ("show", "gain_of_speed")])
def test_an_fmu_is_not_taken_for_a_family(tmp_path: Path, command: tuple[str, ...]) -> None:
    motor_fmu(tmp_path / "motor.fmu")
    said = refusal("effects", *command, "--family", "motor.fmu")
    assert "an FMU is no family by itself" in said
    assert "expected a family file that names it" in said
    assert "rigctl family new NAME --fmu motor.fmu" in said


def test_settings_of_its_solver_are_no_parameters(tmp_path: Path) -> None:
    """As JModelica and others name them: with an underscore in front."""
    motor_fmu(Path("motor.fmu"))
    described(Path("motor.fmu"), {'name="L"': 'name="_cs_rel_tol"', 'name="J"': 'name="plant._internal"'})
    said = told("family", "new", "drive", "--fmu", "motor.fmu")
    assert "has settings of its solver, left out: plant._internal, _cs_rel_tol" in " ".join(said.split())
    assert set(family()["parameters"]) == {"r", "k", "b"}


@pytest.mark.parametrize("name", ["speed_start", "speedstart", "speed_0", "speed0"])
@pytest.mark.parametrize("unit", ["rad/s", "kg.m2"])
def test_what_sets_an_output_at_the_start_is_no_parameter(tmp_path: Path, name: str, unit: str) -> None:
    """But one that only sounds like it, and is of another dimension, is."""
    motor_fmu(Path("motor.fmu"))
    named = {'name="J"': f'name="{name}"', 'start="2e-4" unit="kg.m2"': f'start="2e-4" unit="{unit}"'}
    described(Path("motor.fmu"), named)
    told("family", "new", "drive", "--fmu", "motor.fmu")
    assert set(family()["parameters"]) == {"r", "k", "b", "l"} | ({name} if unit == "kg.m2" else set())


def test_a_column_that_it_does_not_have_is_a_condition_of_its_parameters(tmp_path: Path) -> None:
    write_bench(tmp_path, resistance=lambda time, volts, winding: 2.0 * (1.0 + 0.004 * (winding - 20.0)))
    given = ("--fmu", "motor.fmu", "--csv", "log.csv", "--condition", "winding", "--measured", "winding")
    drafted = answer("family", "new", "drive", *given)
    roles = {one["name"]: (one["role"], one["origin"]) for one in drafted["columns"]}
    assert roles["winding"] == ("input", "measured")
    assert family()["conditions"] == {"winding": {"value": "29.97 degC"}}
    run = answer("import", "log.csv", "--rig", "rigs/drive.yaml")["run"]
    fixed = Path("models/drive.yaml").read_text("utf-8")
    for name in ("j", "l"):
        fixed = "\n".join(
            line.replace("fit: true", "fit: false") if line.strip().startswith(f"{name}:") else line
            for line in fixed.splitlines()
        )
    Path("models/drive.yaml").write_text(fixed, encoding="utf-8")
    found = answer(
        "diagnose", run, "--model", "models/drive.yaml", "--family", "motor.fmu", "--max-effects", "1"
    )
    assert found["effects"] == ["drift_of_r_with_winding"], found["statement"]


def test_a_condition_that_is_something_else_is_refused(tmp_path: Path) -> None:
    write_bench(tmp_path)
    drafts = ("family", "new", "drive", "--csv", "log.csv")
    said = refusal(*drafts, "--fmu", "motor.fmu", "--condition", "speed", "--leave", "speed")
    assert "--condition: the column is something else, too" in said
    assert "--condition is for the parameters of an FMU" in refusal(*drafts, "--condition", "speed")
    said = refusal(*drafts, "--fmu", "motor.fmu", "--condition", "sped")
    assert "--condition: column, got 'sped'; did you mean 'speed'?" in said.replace("unknown ", "")
