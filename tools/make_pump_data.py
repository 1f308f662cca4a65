"""Cut ``data/pump-*.csv`` out of the data set "Condition monitoring of hydraulic systems".

    python tools/make_pump_data.py CYCLES STATES

CYCLES: its channels at 1 Hz, a row for each second: ``time [s], record, PS1 [bar], PS2 [bar], FS1 [l/min],
TS1 [degC]``.
STATES: a row for each cycle: ``record, cooler_efficiency [%], valve_switching [%], pump_leakage,
accumulator_pressure [bar], unstable``.

For each pump state the last stable cycle of every state of cooler and accumulator is used, with the intact
valve; of each cycle, the four stretches of five seconds in which the pressure has settled. Nothing is
averaged.

``pump-cycles.csv`` has a row for each of 133 consecutive cycles: means over seconds 14 to 17 of pressure, oil
temperature and flow rate, and the pressure downstream of the valve in the second in which it opens and after
it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

#: seconds of a cycle at which a settled stretch begins, and how long it is; the first level has not settled
STARTS, LENGTH = (24, 34, 44, 54), 5
NAMES = {0: "sound", 1: "worn", 2: "badly-worn"}
#: bar; a stretch with a larger change of pressure is at another position in its cycle than the others
MOST = 0.5
#: l/min; below it the valve is closed
LEAST = 5.0
HEADING = "time [s],record,pressure [bar],oil_temperature [degC],flow [l/min]"


def lines_of(cycles: pd.DataFrame) -> list[str]:
    """Return the rows of the settled stretches, each of which is a record."""
    found = []
    for _, alike in cycles.groupby(["cooler_efficiency [%]", "accumulator_pressure [bar]"]):
        number = alike["record"].max()
        one = alike[alike["record"] == number]
        for start in STARTS:
            part = one[one["time [s]"].between(start, start + LENGTH - 1)]
            steady = part["PS1 [bar]"].max() - part["PS1 [bar]"].min() <= MOST
            if not steady or part["FS1 [l/min]"].min() < LEAST:
                continue
            columns = part[["time [s]", "PS1 [bar]", "TS1 [degC]", "FS1 [l/min]"]].itertuples(index=False)
            found += [f"{t - start:g},{number}-{start},{p:g},{oil:g},{flow:g}" for t, p, oil, flow in columns]
    return found


#: consecutive cycles with cooler and accumulator as new, and the averaged seconds
CYCLES, LEVEL = range(1664, 1797), range(14, 18)
#: seconds in which the valve opens, and in which the pressure behind it has settled
OPENS, OPEN = 9, 11
CYCLE_HEADING = (
    "cycle [1],pressure [bar],oil_temperature [degC],open_pressure [bar],flow [l/min],opening_pressure [bar]"
)


def cycle_lines(cycles: pd.DataFrame) -> list[str]:
    """Return a row for each cycle."""
    found = []
    for number in CYCLES:
        one = cycles[cycles["record"] == number].reset_index(drop=True)
        level = one.loc[list(LEVEL), ["PS1 [bar]", "TS1 [degC]", "FS1 [l/min]"]].mean()
        opened, opening = one.loc[OPEN, "PS2 [bar]"], one.loc[OPENS, "PS2 [bar]"]
        pressure, oil, flow = level
        found.append(f"{number},{pressure:.5g},{oil:.5g},{opened:.5g},{flow:.5g},{opening:.5g}")
    return found


def main() -> None:
    cycles, states = (pd.read_csv(path) for path in sys.argv[1:3])
    whole = cycles.merge(states, on="record")
    whole = whole[(whole["valve_switching [%]"] == 100) & (whole["unstable"] == 0)]
    _write("pump-cycles", [CYCLE_HEADING, *cycle_lines(cycles)])
    for state, name in NAMES.items():
        lines = [HEADING, *lines_of(whole[whole["pump_leakage"] == state])]
        _write(f"pump-{name}", lines)


def _write(name: str, lines: list[str]) -> None:
    path = Path("data", f"{name}.csv")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    print(f"{path}: {len(lines) - 1} rows")


if __name__ == "__main__":
    main()
