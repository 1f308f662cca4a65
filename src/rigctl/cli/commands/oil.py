"""`rigctl oil`: density and viscosity over temperature and pressure, beside measured values.

In: an oil of the library, or three measured points, with temperatures and pressures. Out: a table, and
for HL32 the error of the law against published measurements. The laws are in `rigctl.physics.oil`, in SI;
cSt, bar and degC exist only in what this module reads and prints.

Without options the published table is repeated, with the errors of the law and where they are largest.
`--points` takes exactly three: that many constants has Vogel's equation, which is solved and not fitted,
so that no deviation is left to be shown.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigctl.cli.echo import print_json
from rigctl.cli.options.as_json import Json
from rigctl.cli.options.quantities import read_option, read_quantities
from rigctl.errors import RigctlError
from rigctl.units import convert, parse_unit, significant

if TYPE_CHECKING:
    from rich.table import Table

    from rigctl.physics.oil import Misfit, Oil, OilRow

_CENTISTOKES = 1e-6
_BAR = 1e5


def oil(
    name: Annotated[str, typer.Argument(metavar="OIL", help="Oil.")] = "HL32",
    *,
    temperature: Annotated[
        str | None,
        typer.Option(
            "--temperature", "-t", help="Temperatures: '40 degC', '20, 40, 60 degC' or '20:80:10 degC'."
        ),
    ] = None,
    pressure: Annotated[
        str | None,
        typer.Option("--pressure", "-p", help="Gauge pressures in the same form, e.g. '0:50:10 bar'."),
    ] = None,
    points: Annotated[
        str | None,
        typer.Option(help="Three measured points (Pa*s or cSt) from which Vogel's constants are calculated."),
    ] = None,
    model: Annotated[str, typer.Option(help="Pressure law: barus or modulus.")] = "barus",
    as_json: Json = False,
) -> None:
    """Show an oil's density and viscosity, and compare the law with published measurements.

    Without options it prints the published table of HL32 with the percentage errors of the law, and where
    they are largest.

    Example: rigctl oil --temperature "20:80:20 degC" --pressure "0, 50 bar"

    Example: rigctl oil --points "20 degC=85.19 cSt, 40 degC=33.81 cSt, 100 degC=5.74 cSt"
    """
    from rigctl.physics.oil import HL32, find_oil, misfit, oil_table, published_viscosity

    chosen = find_oil(name)
    published = published_viscosity() if chosen is HL32 else ()
    if points is not None:
        chosen = _through_points(chosen, points)
    temperatures = (
        [point.temperature for point in published]
        if temperature is None and published
        else read_quantities(temperature or "0:100:10 degC", "K")
    )
    rows = oil_table(chosen, temperatures, read_quantities(pressure or "0 bar", "Pa"), model)
    errors = misfit(chosen.kinematic_viscosity, [(p.temperature, p.kinematic_measured) for p in published])
    if as_json:
        print_json(_document(chosen, model, rows, errors), indent=1)
    else:
        has_conditions = temperature is not None or pressure is not None
        _show(chosen, model, rows if has_conditions or not errors else (), errors)


def _through_points(oil: Oil, text: str) -> Oil:
    """The oil with Vogel's constants solved from ``T=viscosity`` pairs."""
    from rigctl.physics.oil import vogel_from_points

    pairs: list[tuple[float, float]] = []
    for item in text.split(","):
        left, equals, right = item.partition("=")
        if not equals:
            raise RigctlError(
                "not a measured point",
                value=item.strip(),
                expected="'temperature=viscosity', e.g. 20 degC=85.19 cSt",
            )
        temperature = read_option("--points", left, "K").si
        given = read_option("--points", right, "Pa*s", "m^2/s")
        kinematic = given.unit.dimension == parse_unit("m^2/s").dimension
        viscosity = given.si * oil.density(temperature) if kinematic else given.si
        pairs.append((temperature, viscosity))
    return replace(oil, vogel=vogel_from_points(pairs), source="Vogel constants solved from the given points")


def _statement(errors: tuple[Misfit, ...]) -> str:
    from rigctl.physics.oil import largest_misfit

    worst = largest_misfit(errors)
    side = "above" if worst.error > 0.0 else "below"
    return (
        f"The misfit is largest at {convert(worst.temperature, 'K', 'degC'):.0f} degC, where the measured "
        f"viscosity is {abs(100.0 * worst.error):.2f} % {side} the law."
    )


def _document(oil: Oil, model: str, rows: tuple[OilRow, ...], errors: tuple[Misfit, ...]) -> dict[str, Any]:
    a1, a2, b1, b2 = oil.modulus
    document: dict[str, Any] = {
        "oil": oil.name,
        "model": model,
        "constants": {
            "density_15": {"value": oil.density_15, "unit": "kg/m^3"},
            "thermal_expansion": {"value": oil.thermal_expansion, "unit": "1/K"},
            "vogel_a": {"value": oil.vogel.a, "unit": "Pa*s"},
            "vogel_b": {"value": oil.vogel.b, "unit": "K"},
            "vogel_c": {"value": oil.vogel.c, "unit": "K"},
            "barus": {"value": oil.pressure_viscosity * _BAR, "unit": "1/bar"},
            "modulus_a1": {"value": a1 / _BAR, "unit": "bar"},
            "modulus_a2": {"value": a2 / _BAR, "unit": "bar/K"},
            "modulus_b1": {"value": b1, "unit": "1"},
            "modulus_b2": {"value": b2, "unit": "1/K"},
        },
        "source": oil.source,
        "units": {
            "temperature": "degC",
            "pressure": "bar",
            "density": "kg/m^3",
            "kinematic_viscosity": "cSt",
            "dynamic_viscosity": "Pa*s",
        },
        "rows": [
            {
                "temperature": round(convert(row.temperature, "K", "degC"), 9),
                "pressure": row.pressure / _BAR,
                "density": row.density,
                "kinematic_viscosity": row.kinematic_viscosity / _CENTISTOKES,
                "dynamic_viscosity": row.dynamic_viscosity,
            }
            for row in rows
        ],
    }
    if errors:
        document["published"] = [_published_row(oil, row) for row in errors]
        document["largest_misfit"] = max(document["published"], key=lambda row: abs(row["error_percent"]))
        document["statement"] = _statement(errors)
    return document


def _published_row(oil: Oil, row: Misfit) -> dict[str, float]:
    density = oil.density(row.temperature)
    return {
        "temperature": round(convert(row.temperature, "K", "degC"), 9),
        "kinematic_viscosity_measured": row.measured / _CENTISTOKES,
        "kinematic_viscosity": row.law / _CENTISTOKES,
        "dynamic_viscosity_measured": row.measured * density,
        "dynamic_viscosity": row.law * density,
        "error_percent": 100.0 * row.error,
    }


def _show(oil: Oil, model: str, rows: tuple[OilRow, ...], errors: tuple[Misfit, ...]) -> None:
    from rich.console import Console

    console = Console(highlight=False)
    vogel = oil.vogel
    console.print(f"[bold]{oil.name}[/], {oil.description}")
    console.print(
        f"density {oil.density_15:g} kg/m³ at 15 degC, expansion {oil.thermal_expansion:g} 1/K; "
        f"Vogel a = {significant(vogel.a, 5)} Pa*s, b = {vogel.b:.7g} K, c = {vogel.c:.7g} K",
        soft_wrap=True,
    )
    console.print(f"[dim]{oil.source}[/]", soft_wrap=True)
    if rows:
        console.print(
            f"\nviscosity under pressure by the {'Barus law' if model == 'barus' else 'modulus equation'}"
        )
        console.print(_table_of_rows(rows))
    if errors:
        if not rows:
            console.print("\nmeasured (published) beside the law, at atmospheric pressure")
            console.print(_table_of_errors(oil, errors))
        console.print(_statement(errors), soft_wrap=True)


def _table_of_rows(rows: tuple[OilRow, ...]) -> Table:
    table = _table("T [degC]", "p [bar]", "density [kg/m³]", "ν [cSt]", "µ [Pa*s]")
    for row in rows:
        table.add_row(
            significant(convert(row.temperature, "K", "degC"), 5),
            significant(row.pressure / _BAR),
            f"{row.density:.2f}",
            f"{row.kinematic_viscosity / _CENTISTOKES:.4f}",
            f"{row.dynamic_viscosity:.7f}",
        )
    return table


def _table_of_errors(oil: Oil, errors: tuple[Misfit, ...]) -> Table:
    from rigctl.physics.oil import largest_misfit

    table = _table("T [degC]", "ν measured [cSt]", "ν law [cSt]", "µ law [Pa*s]", "error [%]")
    worst = largest_misfit(errors)
    for row in errors:
        table.add_row(
            f"{convert(row.temperature, 'K', 'degC'):.0f}",
            f"{row.measured / _CENTISTOKES:.2f}",
            f"{row.law / _CENTISTOKES:.5f}",
            f"{row.law * oil.density(row.temperature):.9f}",
            f"{round(100.0 * row.error, 2) + 0.0:+.2f}",
            style="bold" if row is worst else "",
        )
    return table


def _table(*columns: str) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for column in columns:
        # a title in brackets would be read as markup
        table.add_column(column.replace("[", r"\["), justify="right")
    return table
