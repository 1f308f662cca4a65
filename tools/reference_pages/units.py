"""The reference page of units, generated from the tables of the reader of quantities."""

from __future__ import annotations

from rigctl.units import SPELLINGS, UNITS_OF, parse_unit

_HEAD = """\
# Units

*Generated: `make docs`.*

Every quantity in a file, on the command line and in the heading of a column has a unit: `30 bar`, `0.5 K`,
`1500 rpm`, `speed [rpm]`. Internally everything is SI. A unit is a name, or names with integer powers, `*`,
`/` and parentheses: `N*s/m`, `J/(kg*K)`, `m^2`. `N·m²` and `W/(m²·K)` are also accepted. An unknown unit is
an error that names the nearest one.

| quantity | units | SI |
|---|---|---|
"""

_TAIL = """
Prefixes (`m`, `u`, `k`, `M` ...) and the other units that [pint](https://pint.readthedocs.io) knows by a
single name are also accepted.

- **Temperatures.** `degC` and `degF` are points on a scale, `K` is a point or a difference. Where a
  difference is meant (a tolerance, a scale, an uncertainty), `0.5 degC` and `0.5 K` are the same. In a
  product write `K`: `W/K`.
- **Rotation.** `rpm`, `U/min` and `rev/min` are speeds of rotation: 1 rpm is 2π/60 rad/s. `1/min` is a
  frequency: 1/60 Hz. A radian is dimensionless, so that the dimension check cannot distinguish the two.
- **Per cent.** `50 %` is 0.5.
- **Current and charge.** `C` is a coulomb; a temperature is `degC`.

## Other spellings

| written | read as |
|---|---|
"""


def units_page() -> str:
    """Return the page."""
    rows = []
    for quantity, units in UNITS_OF.items():
        dimension = parse_unit(units[0]).dimension
        rows.append(f"| {quantity} | {', '.join(f'`{unit}`' for unit in units)} | `{dimension}` |\n")
    spellings = [f"| `{written}` | `{read.strip('()')}` |\n" for written, read in SPELLINGS.items()]
    spellings.append("| `U/min`, `rev/min`, `r/min` | `rpm` |\n")
    return _HEAD + "".join(rows) + _TAIL + "".join(spellings)
