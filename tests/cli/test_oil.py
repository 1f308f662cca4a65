"""`rigctl oil`: its output, its JSON, and its messages for mistyped quantities."""

from __future__ import annotations

from functools import partial

import pytest

import commands
from rigctl.cli.options.quantities import read_quantities
from rigctl.errors import RigctlError

answer = partial(commands.answer, "oil")


def test_the_output_shows_the_published_table_and_its_inconsistencies() -> None:
    told = commands.told("oil")
    assert "85.19009" in told
    assert "+3.11" in told
    assert "largest at 80 degC" in told


def test_json_holds_the_published_errors() -> None:
    document = answer()
    assert len(document["published"]) == 13
    assert document["largest_misfit"]["temperature"] == 80.0
    assert document["largest_misfit"]["error_percent"] == pytest.approx(3.1126, abs=1e-4)


def test_a_table_is_printed_for_a_grid_of_temperatures_and_pressures() -> None:
    document = answer("--temperature", "20:80:30 degC", "--pressure", "0, 100 bar")
    assert [(r["temperature"], r["pressure"]) for r in document["rows"]] == [
        (t, p) for t in (20.0, 50.0, 80.0) for p in (0.0, 100.0)
    ]
    barus = document["rows"][1]["dynamic_viscosity"] / document["rows"][0]["dynamic_viscosity"]
    assert barus == pytest.approx(1.2214, abs=1e-4)
    modulus = answer("--temperature", "20 degC", "--pressure", "100 bar", "--model", "modulus")
    assert modulus["rows"][0]["dynamic_viscosity"] != document["rows"][1]["dynamic_viscosity"]


def test_dynamic_or_kinematic_viscosities_give_vogels_constants() -> None:
    dynamic = answer("--points", "20 degC=7.3856e-2 Pa*s, 40 degC=2.89e-2 Pa*s, 100 degC=4.697e-3 Pa*s")
    assert dynamic["constants"]["vogel_b"]["value"] == pytest.approx(1132.001, abs=1e-3)
    rows = answer("--temperature", "20, 40, 100 degC")["rows"]
    text = ", ".join(f"{r['temperature']} degC={r['kinematic_viscosity']} cSt" for r in rows)
    kinematic = answer("--points", text)
    assert kinematic["constants"]["vogel_c"]["value"] == pytest.approx(147.4466, abs=1e-4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["HL23"], "did you mean 'HL32'"),
        (["--temperature", "20 bar"], "expected a temperature"),
        (["--temperature", "20"], "the unit is missing"),
        (["--temperature", "20:80:-1 degC"], "never ends"),
        (["--temperature", "20:80 degC"], "not a range"),
        (["--temperature", "0:80:1e-6 degC"], "too long"),
        (["--temperature", "-200 degC"], "Vogel's law has no value"),
        (["--points", "20 degC"], "not a measured point"),
        (["--points", "20 degC=1 Pa*s"], "three points"),
        (["--points", "20 s=1 Pa*s"], "--points: wrong dimension, got '20 s'; expected a temperature in K"),
        (
            ["--points", "20 degC=1"],
            "--points: the unit is missing, got '1'; expected a dynamic viscosity in Pa*s or mPa*s or a "
            "kinematic viscosity in m^2/s or cSt",
        ),
        (["--model", "barius"], "did you mean 'barus'"),
    ],
)
def test_mistakes_have_clear_messages(arguments: list[str], message: str) -> None:
    assert message in commands.refusal("oil", *arguments)


def test_ranges_include_their_end_and_may_descend() -> None:
    assert read_quantities("20:50:10 bar", "Pa") == [20e5, 30e5, 40e5, 50e5]
    assert read_quantities("50:20:-15 bar", "Pa") == [50e5, 35e5, 20e5]
    assert read_quantities("0.1:0.3:0.1 bar", "Pa") == pytest.approx([1e4, 2e4, 3e4])
    assert read_quantities("1 bar, 200 kPa", "Pa") == [1e5, 2e5]
    with pytest.raises(RigctlError, match="not a quantity"):
        read_quantities("20,, 30 bar", "Pa")
