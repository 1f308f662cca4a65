"""The texts and numbers of a file that mark a missing value.

`MISSING` are texts that also mean "no record"; `NO_VALUE` adds what loggers and instruments write for an
invalid reading; `NO_NUMBER` are numbers beyond any measurement, which are none in any column. Numbers
that could be readings, such as −9999, are in `rigctl.dataset.importing.cells.sentinels`, as their column
decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

#: texts of a missing value, or of no record
MISSING: Final = (
    "",
    "nan",
    "NaN",
    "NAN",
    "NA",
    "N/A",
    "n/a",
    "#N/A",
    "#NV",
    "null",
    "NULL",
    "-",
    "--",
    "---",
)
#: texts by which loggers and instruments mark invalid values: not connected, overload, error
NO_VALUE: Final = (
    *MISSING,
    *("----", "-----", "None", "none", "?", "*", "***", "bad", "Bad", "BAD", "invalid", "Invalid", "INVALID"),
    *(
        "err",
        "Err",
        "ERR",
        "error",
        "Error",
        "ERROR",
        "#ERROR",
        "#VALUE!",
        "#DIV/0!",
        "#REF!",
        "open",
        "OPEN",
    ),
    *(
        "OL",
        "O.L",
        "O.L.",
        "+OL",
        "-OL",
        "OVL",
        "OVLD",
        "OVER",
        "Over",
        "+OVER",
        "-OVER",
        "OVERLOAD",
        "Overload",
    ),
    *("+++++", "++++++", "+++++++", "-------", "------", "*****", "******", "BURNOUT", "Burnout", "BURN OUT"),
    *("+OVERFLOW", "-OVERFLOW", "UNDER", "Under", "-UNDER", "UNDERRANGE", "Underrange", "#NUM!", "#NAME?"),
    *("overload", "OVERFLOW", "Overflow", "overflow", "OVERRANGE", "Overrange", "OVER RANGE", "Over Range"),
)
#: numbers by which instruments mark overload and missing values: those of SCPI, and the largest 32-bit ones
NO_NUMBER: Final = (
    *(9.9e37, -9.9e37, 9.91e37, 1e30, -1e30, 1e31, -1e31, 1e37, -1e37, 1e38, -1e38),
    *(3.4e38, -3.4e38, 3.402823e38, -3.402823e38, 3.40282e38, -3.40282e38),
    *(3.4028234663852886e38, -3.4028234663852886e38, 1.7976931348623157e308, -1.7976931348623157e308),
)


def is_comment(cells: Sequence[str]) -> bool:
    """Return whether a row is a comment: it begins with ``#``, which is not that of a value such as ``#N/A``
    or the name of a column that counts the rows.

    Whether ``%`` begins a comment, as MATLAB's, is judged with the rows around it: it is a unit as well.
    """
    first = cells[0].strip() if cells else ""
    return first.startswith("#") and first not in NO_VALUE and not (first == "#" and len(cells) > 2)
