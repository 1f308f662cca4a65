"""`rigctl family new` on files made by SciPy, following only the commands that it suggests."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from commands import answer, refusal, told
from rigctl.dataset import open_run
from rigctl.proposal.templates import TEMPLATES


@pytest.fixture(autouse=True)
def empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    told("init", "--minimal")
    return tmp_path


def tanks(path: Path) -> None:
    """Two tanks in a row behind a pump that is switched twice, levels read to half a millimetre."""
    rng = np.random.default_rng(4)
    root = 0.61 * np.sqrt(2.0 * 9.80665)

    def pump(t: float) -> float:
        return (6.0 if t < 150.0 else 2.0 if t < 300.0 else 4.0) / 60e3

    def change(t: float, h: np.ndarray) -> list[float]:
        out = [4e-5 * root * np.sqrt(h[0]), 3e-5 * root * np.sqrt(h[1])]
        return [(pump(t) - out[0]) / 0.015, (out[0] - out[1]) / 0.02]

    times = np.arange(0.0, 450.0, 1.0)
    found = solve_ivp(change, (0.0, 450.0), [0.05, 0.08], t_eval=times, max_step=1.0).y.T
    noisy = 100.0 * found + rng.normal(0.0, 0.05, found.shape)
    rows = [
        f"{t:.1f},{pump(t) * 60e3:.1f},{lower:.3f},{upper:.3f}"
        for t, (upper, lower) in zip(times, noisy, strict=True)
    ]
    path.write_text(
        "\n".join(["t_s,Pump flow (l/min),lower [cm],upper [cm]", *rows]) + "\n", encoding="utf-8"
    )


def pump_curve(path: Path) -> None:
    """A table without time: a head over a flow."""
    rng = np.random.default_rng(1)
    flow = np.repeat(np.linspace(0.0, 40.0, 12), 3)
    head = 21.0 - 0.02 * flow - 0.008 * flow**2 + rng.normal(0.0, 0.1, flow.size)
    rows = [f"{q:.2f},{h:.3f}" for q, h in zip(flow, head, strict=True)]
    path.write_text("\n".join(["flow [l/min],head [m]", *rows]) + "\n", encoding="utf-8")


def follow(commands: list[str]) -> None:
    """Run the suggested next command."""
    for command in commands:
        words = shlex.split(command)
        assert words[0] == "rigctl"
        told(*words[1:])


def test_a_family_for_two_tanks_is_drafted_from_a_log_and_compared(empty: Path) -> None:
    tanks(empty / "log.csv")
    done = answer("family", "new", "tanks", "--csv", "log.csv", "--template", "tank")
    roles = {column["name"]: (column["role"], column["unit"]) for column in done["columns"]}
    assert roles == {"pump_flow": ("input", "l/min"), "lower": ("output", "cm"), "upper": ("output", "cm")}
    assert (empty / done["plot"]).stat().st_size > 10_000
    for fitted in done["fit"]["outputs"].values():
        assert fitted["rmse"] < 0.01 * fitted["range"]
    family = (empty / done["family"]).read_text(encoding="utf-8")
    assert family.index("  upper:") < family.index("  lower:")  # the pump fills the upper one
    follow(done["next"])
    compared = answer("compare", "latest", "--model", done["model"], "--no-fit")
    assert {"upper", "lower"} == set(compared["channels"])


def test_a_project_is_created_in_a_folder_without_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    pump_curve(tmp_path / "log.csv")
    done = answer("family", "new", "pump", "--csv", "log.csv", "--input", "flow", "--no-fit")
    assert (tmp_path / "rigctl.toml").exists()
    follow(done["next"][:1])
    assert refusal("family", "new", "pump", "--csv", "log.csv")
    told("family", "new", "other", "--template", "heater")  # and the marker stays as it is


def test_the_readme_of_a_minimal_project_can_be_followed(empty: Path) -> None:
    text = steps("time [s],push [V],sensor [V]", lambda t: 3.0 * (1.0 - np.exp(-max(t - 2.0, 0.0) / 1.7)))
    (empty / "log.csv").write_text(text, encoding="utf-8")
    lines = (empty / "README.md").read_text(encoding="utf-8").splitlines()
    commands = [line.partition("#")[0].strip() for line in lines if line.startswith("    ")]
    assert len(commands) >= 5
    (device,) = [one for one in commands if "PORT" in one]  # nothing is plugged in here
    assert device.startswith("rigctl doctor --rig rigs/line-device.yaml --port")
    follow([one for one in commands if one != device])
    named = (empty / "rigctl.toml").read_text(encoding="utf-8").partition('# rig = "')[2].partition('"')[0]
    assert (empty / named).is_file()


def test_a_table_without_time_becomes_a_static_family(empty: Path) -> None:
    pump_curve(empty / "curve.csv")
    done = answer("family", "new", "Pump curve", "--csv", "curve.csv", "--template", "flow")
    assert done["name"] == "pump_curve"
    assert "states:" not in (empty / done["family"]).read_text(encoding="utf-8")
    assert done["fit"]["outputs"]["head"]["rmse"] < 0.13
    told("import", "curve.csv", "--rig", done["rig"])
    compared = answer("compare", "latest", "--model", done["model"])
    assert compared["adequate"]
    plain = answer("compare", "latest", "--model", done["model"], "--no-fit")
    assert plain["channels"]["head"]["rmse"] < 0.2


@pytest.mark.parametrize("template", sorted(TEMPLATES))
def test_every_template_is_checked_and_simulates(template: str) -> None:
    done = answer("family", "new", "bench", "--template", template)
    for kind in ("family", "rig", "model", "procedure"):
        assert answer("check", done[kind])["kind"] == kind
    run = open_run(answer("simulate", done["procedure"])["run"])
    assert all(np.isfinite(values).all() for values in run.record(0).channels.values())


def steps(name: str, write: Callable[[float], float]) -> str:
    rows = [f"{0.1 * k:.1f},{1.0 if k > 20 else 0.0},{write(0.1 * k):.4f}" for k in range(200)]
    return "\n".join([name, *rows]) + "\n"


@pytest.mark.parametrize(
    ("least", "most", "ends"),
    [("0", "12.0044", "low: 0 V, high: 12.01 V"), ("-12.0044", "0", "low: -12.01 V, high: 0 V")],
)
def test_the_drafted_limits_of_a_command_hold_its_own_data(
    empty: Path, least: str, most: str, ends: str
) -> None:
    rows = [f"{0.1 * k:.1f},{most if 20 < k < 90 else least},{0.01 * k:.4f}" for k in range(200)]
    (empty / "a.csv").write_text("\n".join(["time [s],drive [V],sensor [V]", *rows]) + "\n", encoding="utf-8")
    done = answer("family", "new", "lag", "--csv", "a.csv", "--no-fit", "--commanded", "drive")
    assert ends in (empty / done["rig"]).read_text(encoding="utf-8")
    follow(done["next"][:1])


def test_without_a_template_every_output_is_a_first_order_lag(empty: Path) -> None:
    def answer_of(t: float) -> float:
        return 0.5 if t < 2.0 else 0.5 + 3.0 * (1.0 - np.exp(-(t - 2.0) / 1.7))

    (empty / "a.csv").write_text(steps("time [s],drive [V],sensor", answer_of), encoding="utf-8")
    done = answer("family", "new", "lag", "--csv", "a.csv", "--no-fit", "--unit", "sensor=N*m")
    model = (empty / done["model"]).read_text(encoding="utf-8")
    constant = float(model.partition("time_constant: {value: ")[2].partition(" ")[0])
    gain = float(model.partition("gain: {value: ")[2].partition(" ")[0])
    assert constant == pytest.approx(1.7, rel=0.1)
    assert gain == pytest.approx(3.0, rel=0.05)
    assert (
        done["next"][0] == "rigctl import a.csv --rig rigs/lag.yaml"
    )  # which knows the unit by the rig file
    assert '"sensor [N*m]"' in (empty / "log-formats/lag.yaml").read_text(encoding="utf-8")
    assert done["fit"]["problem"] == "not asked for"


def test_the_column_that_leads_the_others_becomes_the_input(empty: Path) -> None:
    rng = np.random.default_rng(0)
    drive = np.cumsum(rng.normal(0.0, 1.0, 400))
    late = np.concatenate([np.zeros(5), drive[:-5]]) + rng.normal(0.0, 0.05, 400)
    rows = [f"{0.1 * k:.1f},{late[k]:.4f},{drive[k]:.4f}" for k in range(400)]
    (empty / "b.csv").write_text("\n".join(["time [s],a [V],b [V]", *rows]) + "\n", encoding="utf-8")
    done = answer("family", "new", "lead", "--csv", "b.csv", "--no-fit")
    assert {c["name"]: c["role"] for c in done["columns"]} == {"a": "output", "b": "input"}
    said = answer("family", "new", "said", "--csv", "b.csv", "--no-fit", "--input", "a", "--output", "b")
    assert {c["name"]: c["role"] for c in said["columns"]} == {"a": "input", "b": "output"}


@pytest.mark.parametrize(("unit", "full"), [("%", 100.0), ("1", 1.0), ("mV", 5000.0)])
def test_the_drafted_heater_model_follows_the_log_before_any_fit_in_every_unit(
    empty: Path, unit: str, full: float
) -> None:
    """A body with a rise of 40 K at full power and a time constant of 30 s."""
    rng = np.random.default_rng(2)
    rows, body, duty = [], 22.0, 0.0
    for k in range(240):
        rows.append(f"{k},{duty * full:g},{body + rng.normal(0.0, 0.05):.3f}")
        duty = 0.0 if k < 20 else 0.5 if k < 130 else 0.9
        body = 22.0 + 40.0 * duty + (body - 22.0 - 40.0 * duty) * np.exp(-1.0 / 30.0)
    head = f"time [s],duty [{unit}],body [degC]"
    (empty / "log.csv").write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    done = answer("family", "new", "heat", "--csv", "log.csv", "--template", "heater", "--no-fit")
    follow([command for command in done["next"] if command.startswith("rigctl import")])
    compared = answer("compare", "latest", "--model", done["model"], "--no-fit")
    assert compared["channels"]["body"]["rmse"] < 1.0


def test_errors_of_a_temperature_are_in_kelvin_on_every_scale(empty: Path) -> None:
    """One log of a body with a time constant of 30 s, in degrees Celsius and Fahrenheit."""
    celsius = 22.0 + 36.0 * (1.0 - np.exp(-np.maximum(0.0, np.arange(240.0) - 20.0) / 30.0))
    first = {}
    for name, scale in (("degC", celsius), ("degF", 1.8 * celsius + 32.0)):
        rows = [f"{k},{100.0 if k >= 20 else 0.0:g},{value:.4f}" for k, value in enumerate(scale)]
        text = "\n".join([f"time [s],duty [%],body [{name}]", *rows]) + "\n"
        (empty / f"{name}.csv").write_text(text, encoding="utf-8")
        done = answer("family", "new", f"heat_{name.lower()}", "--csv", f"{name}.csv", "--template", "heater")
        first[name] = done["fit"]["outputs"]["body"]
    assert first["degF"]["unit"] == first["degC"]["unit"] == "K"
    assert first["degF"]["range"] == pytest.approx(np.ptp(celsius), rel=1e-3)
    assert first["degF"]["rmse"] == pytest.approx(first["degC"]["rmse"], rel=0.02, abs=1e-3)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["x"], "nothing to begin with"),
        (["x", "--template", "moter"], "did you mean 'motor'"),
        (["x", "--csv", "c.csv", "--template", "motor"], "the template needs the voltage as an input"),
        (["x", "--csv", "c.csv", "--unit", "flwo=V"], "did you mean 'flow'"),
        (["heater_board", "--template", "heater"], "there is a model family of this name already"),
        (["9", "--template", "heater"], "not a valid name for a family"),
        (["Con", "--template", "heater"], "a device on Windows has this name"),
    ],
)
def test_mistakes_are_reported_and_no_family_is_written(empty: Path, arguments: list[str], said: str) -> None:
    pump_curve(empty / "c.csv")
    assert said in refusal("family", "new", *arguments)
    assert not (empty / "families").exists()


def test_two_columns_of_one_name_are_refused(empty: Path) -> None:
    """The suggested import was refused, since nothing distinguishes them."""
    (empty / "log.csv").write_text("time [s],T [degC],T [degC]\n0,1,2\n1,2,3\n2,3,5\n", encoding="utf-8")
    said = refusal("family", "new", "x", "--csv", "log.csv", "--no-fit")
    assert "log.csv:1:19: the column is there twice, got 'T'. Rename one of them in the file" in said


def test_an_existing_family_is_not_overwritten() -> None:
    told("family", "new", "x", "--template", "heater")
    before = {path: path.read_bytes() for path in Path().rglob("*.yaml")}
    assert before
    assert "already there" in refusal("family", "new", "x", "--template", "motor")
    assert {path: path.read_bytes() for path in Path().rglob("*.yaml")} == before


def test_dates_decimal_commas_and_german_headings_of_a_logger_are_read(empty: Path) -> None:
    def row(k: int) -> str:
        speed = f"{1000.0 * (1.0 - np.exp(-max(0, k - 10) / 8.0)):.2f}".replace(".", ",")
        return f"2026-03-01 10:00:{k / 2:04.1f};{'6,0' if k > 10 else '0,0'};{speed};Motor kalt"

    text = "\n".join(["Zeit;Spannung (V);Drehzahl (U/min);Notiz", *map(row, range(100))]) + "\n"
    (empty / "log.csv").write_text(text, encoding="utf-8")
    done = answer("family", "new", "antrieb", "--csv", "log.csv", "--template", "motor")
    assert {c["name"]: c["role"] for c in done["columns"]} == {"spannung": "input", "drehzahl": "output"}
    assert done["fit"]["outputs"]["drehzahl"]["rmse"] < 10.0
    assert "quantity: angular_speed" in (empty / done["rig"]).read_text(encoding="utf-8")
    follow(done["next"][:1])
    assert open_run("latest").record(0).channels["drehzahl"].size == 100


@pytest.mark.parametrize("name", ["Clock", "Stamp 1"])
def test_a_time_column_of_any_name_may_pass_midnight_and_repeat_rows(empty: Path, name: str) -> None:
    def row(k: int) -> str:
        level = 300.0 * (1.0 - np.exp(-max(0, k - 10) / 30.0))
        seconds = (86340 + 2 * k) % 86400
        clock = f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"
        return f"{clock},{6 if k > 10 else 0},{level:.1f}"

    rows = [row(k) for k in range(90)]
    rows[40:40] = rows[38:40][-1:]
    (empty / "log.csv").write_text(
        "\n".join([f"{name},Heater [W],Oven [degC]", *rows]) + "\n", encoding="utf-8"
    )
    done = answer("family", "new", "oven", "--csv", "log.csv")
    assert {c["name"]: c["role"] for c in done["columns"]} == {"heater": "input", "oven": "output"}
    assert done["fit"]["problem"] is None
    follow(done["next"][:1])
    record = open_run("latest").record(0)
    assert record.channels["oven"].size == 90
    assert np.diff(record.time).tolist() == [2.0] * 89
    assert open_run("latest").info["duration"] == 178.0


def test_a_speed_in_1_per_min_is_read_as_rpm_and_the_room_temperature_is_no_output(empty: Path) -> None:
    """``1/min`` is any count per minute; in a column named Drehzahl it means revolutions per minute."""

    def row(k: int) -> str:
        speed = 900.0 * (1.0 - np.exp(-max(0, k - 10) / 15.0)) + 0.3 * np.sin(7.0 * k)
        cells = (f"{0.2 * k:.1f}", f"{9 if k > 10 else 0}", f"{speed:.1f}", f"{21.3 + 0.1 * (k % 3):.1f}")
        return ";".join(cells).replace(".", ",")

    text = "\n".join(["Zeit;Strom;Drehzahl;Raumtemperatur", "s;A;1/min;°C", *map(row, range(120))])
    (empty / "log.csv").write_text(text, encoding="cp1252")
    done = answer("family", "new", "rad", "--csv", "log.csv", "--no-fit")
    roles = {c["name"]: c["role"] for c in done["columns"]}
    assert roles == {"strom": "input", "drehzahl": "output", "raumtemperatur": "input"}
    assert "unit: rpm" in (empty / done["rig"]).read_text(encoding="utf-8")
    follow(done["next"][:1])
    assert open_run("latest").record(0).channels["drehzahl"].max() == pytest.approx(94.2, rel=0.01)  # rad/s
    answer("import", "log.csv", "--rig", done["rig"])
    assert open_run("latest").record(0).channels["drehzahl"].max() == pytest.approx(94.2, rel=0.01)
    other = text.replace("Drehzahl", "n")
    (empty / "log.csv").write_text(other, encoding="cp1252")
    said = refusal("import", "log.csv", "--rig", done["rig"], "--columns", "n=drehzahl")
    assert "may be turns or radians" in said
    assert "--columns 'drehzahl=" in said


def test_columns_with_reserved_names_are_renamed_and_mapped(empty: Path) -> None:
    rows = [f"{k},{k // 10 % 2},{np.sin(k):.3f},{k % 3}" for k in range(40)]
    (empty / "n.csv").write_text(
        "\n".join(["time [s],rest [V],pi [V],Pi [V]", *rows]) + "\n", encoding="utf-8"
    )
    done = answer("family", "new", "names", "--csv", "n.csv", "--no-fit")
    assert [c["name"] for c in done["columns"]] == ["rest_value", "pi_value", "pi_value_2"]
    follow(done["next"][:1])


def test_an_input_that_no_equation_of_the_template_contains_is_kept_for_effects(empty: Path) -> None:
    """A stirrer of a heated tank: with it missing from the family, no effect could depend on it."""
    times = np.arange(0.0, 600.0, 10.0)
    rng = np.random.default_rng(2)
    water = 20.0 + 0.02 * times + rng.normal(0.0, 0.02, times.size)
    rows = [
        f"{t:g},{100 * (t > 50):g},{300 + 300 * (t > 300):g},{w:.3f}"
        for t, w in zip(times, water, strict=True)
    ]
    head = "time [s],heater [W],stirrer [rpm],water [degC]"
    (empty / "log.csv").write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    told("family", "new", "jar", "--csv", "log.csv", "--template", "heater", "--no-fit")
    checked = told("check", "families/jar.yaml")
    assert "stirrer [rad/s]" in checked
    assert "in no equation yet" in (empty / "families" / "jar.yaml").read_text(encoding="utf-8")


def test_drafted_values_are_estimated_from_separate_records(empty: Path) -> None:
    def row(r: int, k: int) -> str:
        y = 20.0 + 5.0 * (r + 1) * (1.0 - np.exp(-max(0, k - 5) / 8.0))
        return f"{0.5 * k},{r},{r + 1 if k > 5 else 0},{y:.3f}"

    rows = [row(r, k) for r in range(3) for k in range(60)]
    (empty / "r.csv").write_text(
        "\n".join(["time [s],record,u [V],y [degC]", *rows]) + "\n", encoding="utf-8"
    )
    done = answer("family", "new", "steps", "--csv", "r.csv", "--no-fit")
    model = (empty / done["model"]).read_text(encoding="utf-8")
    assert float(model.partition("time_constant: {value: ")[2].partition(" ")[0]) == pytest.approx(
        4.0, rel=0.15
    )
    assert float(model.partition("gain: {value: ")[2].partition(" ")[0]) == pytest.approx(5.0, rel=0.05)


def test_agreement_is_claimed_after_adding_an_effect_only_if_compare_confirms_it(empty: Path) -> None:
    """A hole in the side of a tank: the library's overflow is linear above its limit, the hole is not."""
    rng = np.random.default_rng(7)
    root = 0.62 * np.sqrt(2.0 * 9.80665)

    def pump(t: float) -> float:
        return float(np.array([0.0, 14.0, 6.0, 18.0, 0.0])[np.searchsorted([20.0, 200.0, 420.0, 600.0], t)])

    def change(t: float, h: np.ndarray) -> list[float]:
        hole = 0.9e-4 * root * np.sqrt(max(h[0] - 0.25, 0.0))
        return [(pump(t) / 60e3 - 1.13e-4 * root * np.sqrt(max(h[0], 0.0)) - hole) / 0.045]

    times = np.arange(0.0, 760.0, 2.0)
    level = 1e3 * solve_ivp(change, (0.0, 760.0), [0.08], t_eval=times, max_step=1.0).y[0]
    noisy = level + rng.normal(0.0, 1.2, level.size)
    rows = [f"{t:.0f},{pump(t):.1f},{mm:.0f}" for t, mm in zip(times, noisy, strict=True)]
    (empty / "tank.csv").write_text(
        "\n".join(["time [s],Inlet flow [l/min],Level [mm]", *rows]) + "\n", encoding="utf-8"
    )
    done = answer("family", "new", "tank", "--csv", "tank.csv", "--template", "tank", "--no-fit")
    follow(done["next"][:1])
    added = answer("diagnose", "latest", "--model", done["model"], "--apply")
    assert [step["effects"] for step in added["steps"]] == [["threshold_on_leak_1"]]
    compared = answer("compare", "latest", "--model", done["model"])
    assert compared["adequate"] == ("now agrees" in added["improvement"])


@pytest.mark.parametrize(
    "heading",
    [
        "time_s,voltage_V,speed_rpm",
        "Time,Voltage (V),Speed/rpm",
        "t [s],u [V],n [rpm]",
        "time/s,u/V,omega/(rad/s)",
        "seconds,volts,RPM",
    ],
)
def test_the_two_lines_of_the_readme_work_on_a_log_as_loggers_write_it(empty: Path, heading: str) -> None:
    """Without a name or a unit given by hand."""
    rows = [f"{k / 10},{6 if k > 20 else 0},{max(0, k - 20) * 3 + np.sin(k):.2f}" for k in range(60)]
    (empty / "log.csv").write_text("\n".join([heading, *rows]) + "\n", encoding="utf-8")
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    lines = [line.partition("#")[0].removeprefix("$ ").strip() for line in readme.splitlines()]
    new = next(line for line in lines if line.startswith("rigctl family new motor --csv"))
    bring_in = next(line for line in lines if line.startswith("rigctl import ../log.csv"))
    told(*shlex.split(new.replace("../log.csv", "log.csv"))[1:], "--no-fit")
    told(*shlex.split(bring_in.replace("../log.csv", "log.csv"))[1:])
    assert open_run("latest").record(0).channels


@pytest.mark.parametrize(
    ("heading", "row", "says"),
    [
        ("time,temp,duty", "{k},0,20,1,{m},0", "the heading has 3 names, and the rows below it have 6 cells"),
        ("time [s],a [V],b [V]", "{k},{m},{x}", "b: not a number"),
    ],
)
def test_a_file_that_cannot_be_read_leaves_no_draft(empty: Path, heading: str, row: str, says: str) -> None:
    rows = [row.format(k=k, m=k % 7, x="x" if k == 12 else k) for k in range(30)]
    (empty / "log.csv").write_text("\n".join([heading, *rows, ""]), encoding="utf-8")
    assert says in refusal("family", "new", "odd", "--csv", "log.csv", "--no-fit")
    assert not [*empty.rglob("odd*")]
