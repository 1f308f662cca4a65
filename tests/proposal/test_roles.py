"""Which columns of a log are inputs, and whether they are commanded or measured."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.errors import RigctlError
from rigctl.proposal.columns import Table, read_columns
from rigctl.proposal.roles import StatedRoles, with_roles

Floats = NDArray[np.float64]
TIMES = np.arange(600) * 0.1


def log(folder: Path, columns: Mapping[str, Floats], time: str = "time [s]") -> Table:
    count = len(next(iter(columns.values())))
    rows = [",".join(f"{value:.6g}" for value in row) for row in zip(*columns.values(), strict=True)]
    text = [",".join([time, *columns]), *(f"{0.1 * k:.1f},{rows[k]}" for k in range(count))]
    (folder / "log.csv").write_text("\n".join(text) + "\n", encoding="utf-8")
    return read_columns(folder / "log.csv", {})


def lagged(drive: Floats, share: float = 0.15) -> Floats:
    found = np.zeros(drive.size)
    for k in range(drive.size - 1):
        found[k + 1] = found[k] + share * (drive[k] - found[k])
    return found


def random_switches(random: np.random.Generator) -> Floats:
    return np.repeat(random.integers(0, 2, 100), 6) * 3.0 + 3.41


def multisine(random: np.random.Generator) -> Floats:
    lines = np.arange(1, 200)[:, None] * TIMES[None, :] * (2.0 * np.pi / 60.0)
    return np.asarray(np.cos(lines + random.uniform(0.0, 2.0 * np.pi, 199)[:, None]).sum(axis=0) / 10.0)


def swell(random: np.random.Generator) -> Floats:
    return np.asarray(np.sin(TIMES / 3.0) + 0.6 * np.sin(TIMES / 1.1 + 1.0) + random.normal(0.0, 0.01, 600))


def origins(table: Table) -> dict[str, str]:
    return {c.name: c.origin if c.role == "input" else c.role for c in table.columns}


@pytest.mark.parametrize("signal", [random_switches, multisine])
def test_what_is_switched_or_broad_is_a_command(tmp_path: Path, signal: object) -> None:
    random = np.random.default_rng(1)
    drive = signal(random)  # type: ignore[operator]
    table = log(tmp_path, {"u [V]": drive, "y [V]": lagged(drive) + random.normal(0.0, 0.01, 600)})
    assert origins(with_roles(table, StatedRoles())) == {"u": "commanded", "y": "output"}


def test_a_smooth_input_is_not_judged_but_asked_about(tmp_path: Path) -> None:
    random = np.random.default_rng(2)
    drive = swell(random)
    table = log(tmp_path, {"u [V]": drive, "y [V]": lagged(drive) + random.normal(0.0, 0.01, 600)})
    assert origins(with_roles(table, StatedRoles(inputs=["u"])))["u"] == "unclear"
    assert origins(with_roles(table, StatedRoles(commanded=["u"])))["u"] == "commanded"
    assert origins(with_roles(table, StatedRoles(measured=["u"])))["u"] == "measured"


@pytest.mark.parametrize(
    ("name", "origin"), [("set_duty", "commanded"), ("speed_command", "commanded"), ("room", "measured")]
)
def test_names_say_what_the_data_cannot(tmp_path: Path, name: str, origin: str) -> None:
    random = np.random.default_rng(2)
    drive = swell(random)
    table = log(tmp_path, {f"{name} [V]": drive, "y [V]": lagged(drive)})
    assert origins(with_roles(table, StatedRoles()))[name] == origin


@pytest.mark.parametrize("failed", [slice(0), slice(100, 400)])
def test_related_columns_without_an_input_are_refused_with_the_options(tmp_path: Path, failed: slice) -> None:
    """A damper: the force follows the speed at once, so that neither leads; a sensor may have failed."""
    random = np.random.default_rng(3)
    speed = swell(random)
    force = 40.0 * np.tanh(1.5 * speed)
    force[failed] = np.nan
    table = log(tmp_path, {"speed [m/s]": speed, "force [N]": force})
    with pytest.raises(RigctlError, match="'speed' and 'force' change together") as caught:
        with_roles(table, StatedRoles())
    assert '--input "speed" or --input "force"' in str(caught.value)
    assert '--output "speed" --output "force"' in str(caught.value)
    free = with_roles(table, StatedRoles(outputs=["speed", "force"]))  # released: nothing drives them
    assert set(origins(free).values()) == {"output"}


def test_a_few_readings_with_as_many_values_are_no_command(tmp_path: Path) -> None:
    drive = 4.0 + np.sin(np.arange(11))
    table = log(tmp_path, {"u [V]": drive, "y [V]": lagged(drive, 0.5)})
    found = with_roles(table, StatedRoles(inputs=["u"]))
    assert origins(found)["u"] == "unclear"


def test_unrelated_outputs_need_no_input(tmp_path: Path) -> None:
    random = np.random.default_rng(4)
    table = log(tmp_path, {"a [V]": random.normal(size=600), "b [V]": random.normal(size=600)})
    assert set(origins(with_roles(table, StatedRoles())).values()) == {"output"}


@pytest.mark.parametrize(
    ("columns", "stated", "said"),
    [
        ({"u [V]": 1, "y [V]": "copy"}, {"inputs": ["u"]}, "is the input 'u' once more"),
        ({"u [V]": 1, "y [mV]": "copy"}, {"inputs": ["u"]}, "is the input 'u' once more"),
        ({"u [V]": 1, "y [V]": "two"}, {"inputs": ["u"], "outputs": ["y"]}, "only 2 different values"),
        ({"u [V]": 1, "y [V]": 2}, {"inputs": ["u"], "outputs": ["u"]}, "contradict each other"),
        ({"u [V]": 1, "y [V]": 2}, {"commanded": ["u"], "measured": ["u"]}, "contradict each other"),
        ({"u [V]": 1, "y [V]": 2}, {"commanded": ["v"]}, "column"),
    ],
)
def test_roles_that_explain_nothing_are_refused(
    tmp_path: Path, columns: Mapping[str, object], stated: Mapping[str, list[str]], said: str
) -> None:
    random = np.random.default_rng(5)
    signals: dict[object, Floats] = {1: swell(random), 2: random.normal(size=600)}
    signals["copy"], signals["two"] = signals[1], np.sign(signals[2])
    table = log(tmp_path, {name: signals[key] for name, key in columns.items()})
    with pytest.raises(RigctlError, match=said):
        with_roles(table, StatedRoles(**stated))  # type: ignore[arg-type]


@pytest.mark.parametrize("word", ["Tiempo", "Zeit", "temps", "tempo", "tid", "czas"])
def test_times_are_known_by_their_names_in_other_languages(tmp_path: Path, word: str) -> None:
    table = log(tmp_path, {"u [V]": swell(np.random.default_rng(6))}, time=f"{word} [s]")
    assert table.times is not None
    assert table.renamed[0] == f"{word}=time"  # the heading states its unit itself


def test_temps_in_degrees_are_temperatures(tmp_path: Path) -> None:
    table = log(tmp_path, {"temps [degC]": 20.0 + swell(np.random.default_rng(6))})
    assert [column.name for column in table.columns] == ["temps"]
