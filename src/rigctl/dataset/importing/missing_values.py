"""The texts and numbers of a file that mark a missing value."""

from __future__ import annotations

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
    *("overload", "OVERFLOW", "Overflow", "overflow", "OVERRANGE", "Overrange", "OVER RANGE", "Over Range"),
)
#: numbers by which SCPI instruments mark overload and missing values
NO_NUMBER: Final = (9.9e37, -9.9e37, 9.91e37)
