"""A cell as a number: what it means with a decimal sign, and what cannot be known from it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.dataset.importing import read_table
from rigctl.dataset.importing.cells.missing_values import NO_VALUE, is_comment
from rigctl.dataset.importing.cells.numbers import (
    Thousands,
    ambiguous_sign,
    find_decimal,
    looks_numeric,
    read_number,
)
from rigctl.errors import Location

NAN = math.nan


@pytest.mark.parametrize(
    ("cell", "decimal", "options", "value"),
    [
        ("1.5", ".", {}, 1.5),
        ("1,5", ",", {}, 1.5),
        ("1,5", ".", {}, None),  # of the other sign: perhaps fifteen
        ("1.5", ",", {}, None),
        ("-1.5e-3", ".", {}, -0.0015),
        ("+1,5E3", ",", {}, 1500.0),
        (".5", ".", {}, 0.5),
        ("5.", ".", {}, 5.0),
        ("7", ",", {}, 7.0),
        ("1.2.3", ".", {}, None),
        ("1,2,3", ",", {}, None),
        ("1 5", ".", {}, None),
        ("e5", ".", {}, None),
        ("1e999", ".", {}, None),
        ("1,234.5", ".", {}, 1234.5),
        ("1.234,5", ",", {}, 1234.5),
        ("1,234.5", ",", {}, None),
        ("1.234,5", ".", {}, None),
        ("1,234,567.8", ".", {}, 1234567.8),
        ("1.234.567,8", ",", {}, 1234567.8),
        ("1.234.567,8", ".", {}, None),
        ("1'234.5", ".", {}, 1234.5),
        ("1'234,5", ".", {}, None),
        ("-1 234 567,5", ",", {}, -1234567.5),
        ("1\u202f234,5", ",", {}, 1234.5),
        ("12,34.5", ".", {}, None),
        ("436 250", ".", {}, 436250.0),
        ("1'436'250", ",", {}, 1436250.0),
        ("436 250", ".", {"fractions": True}, None),  # or 436.250
        ("436 250", ".", {"fractions": True, "stated": True}, 436250.0),
        ("436 25", ".", {}, None),
        ("1,234", ".", {}, None),
        ("1,234", ".", {"stated": True}, 1234.0),
        ("1.234", ",", {"stated": True}, 1234.0),
        ("1,234.5", ".", {"stated": True}, 1234.5),
        ("1,23", ".", {"stated": True}, None),
        ("NaN", ".", {}, NAN),
        ("", ".", {}, NAN),
        ("OL", ",", {}, NAN),
        ("x", ".", {"missing": ("x",)}, NAN),
        ("OL", ".", {"missing": ("x",)}, None),
    ],
)
def test_a_cell_is_a_number_is_missing_or_is_neither(
    cell: str, decimal: str, options: dict[str, object], value: float | None
) -> None:
    found = read_number(cell, decimal, **options)  # type: ignore[arg-type]
    assert found == pytest.approx(value, nan_ok=True) if value is not None else found is None


@given(
    value=st.integers(-(10**12), 10**12),
    digits=st.integers(1, 6),
    signs=st.sampled_from([".,", ".'", ". ", ".", ",.", ",'", ",\u00a0", ","]),
)
def test_any_number_is_read_as_a_locale_writes_it(value: int, digits: int, signs: str) -> None:
    """Written by Python's own format, with other signs in the places of its two."""
    decimal, separator = signs[0], signs[1:]
    exact = value / 10**digits
    written = f"{exact:,.{digits}f}".translate({ord(","): separator, ord("."): decimal})
    assert read_number(written, decimal) == float(f"{exact:.{digits}f}")


@pytest.mark.parametrize(
    ("cells", "found"),
    [
        ([], (".", False)),
        (["1", "2"], (".", False)),
        (["1.5", "2.5"], (".", False)),
        (["1,5", "2,5"], (",", False)),
        (["1,5", "2.5"], (".", False)),
        (["1,5", "2,5", "2.5"], (",", False)),
        (["1,234"], (",", True)),
        (["1,234", "2,345", "7"], (",", True)),
        (["1,234", "1,5"], (",", False)),
        (["1,234", "2,345", "0.5"], (",", False)),
        (["0,123"], (",", False)),
    ],
)
def test_the_decimal_sign_is_that_of_most_numbers(cells: list[str], found: tuple[str, bool]) -> None:
    assert find_decimal(cells) == found


def test_a_cell_looks_numeric_with_either_sign_and_where_it_marks_a_missing_value() -> None:
    assert all(looks_numeric(cell) for cell in ("1.5", "1,5", "7", "OL", "", "1,234.5"))
    assert not any(looks_numeric(cell) for cell in ("x", "1.5 V", "2026-01-01"))


# --- does a sign separate thousands?


def signs(*parts: dict[int, list[str]], sign: str = ".") -> Thousands:
    found, line = Thousands(sign), 5
    for part in parts:
        rows = max(map(len, part.values()))
        found.take(part, range(line, line + rows))
        line += rows
    return found


@pytest.mark.parametrize(
    ("column", "ambiguous"),
    [
        (["978", "1.011"], (0, 6, "1.011", "978")),
        (["1.011", "-12.345", "+978", "5"], (0, 5, "1.011", "+978")),
        (["978", "1.011", "OL"], (0, 6, "1.011", "978")),
        (["1.011"], None),  # nothing whole beside it
        (["978"], None),
        (["978", "1.011", "1500"], None),  # it would have a separator
        (["978", "1.011", "0.5"], None),
        (["978", "1.011", "5."], None),
        (["978", "1.011", "+.5"], None),
        (["978", "1.011", "1.5e3"], None),
        (["978", "0.011"], None),
        (["978", "1.011", "."], (0, 6, "1.011", "978")),  # no number
        (["978", "1.011", "+."], (0, 6, "1.011", "978")),
        (["978", "1.011", "3.3 V"], (0, 6, "1.011", "978")),
    ],
)
def test_whole_numbers_beside_three_digits_may_be_thousands(
    column: list[str], ambiguous: tuple[int, int, str, str] | None
) -> None:
    assert signs({0: column}).ambiguous() == ambiguous
    split = [{0: [cell]} for cell in column]  # part by part
    assert signs(*split).ambiguous() == ambiguous
    other = signs({0: [cell.replace(".", ",") for cell in column]}, sign=",").ambiguous()
    assert other == (ambiguous and (*ambiguous[:2], ambiguous[2].replace(".", ","), ambiguous[3]))


def test_a_fraction_of_any_column_settles_the_sign_and_a_long_number_only_its_own() -> None:
    both = {3: ["978", "1.011"], 1: ["12", "2.022"]}
    assert signs(both).ambiguous() == (1, 6, "2.022", "12")
    assert signs({**both, 2: ["0.5"]}).ambiguous() is None
    assert signs({**both, 2: ["0.5"]}).settled
    assert not signs(both).settled
    assert signs({**both, 1: ["12", "2.022", "1500"]}).ambiguous() == (3, 6, "1.011", "978")
    assert signs({3: ["978"], 1: ["2.022"]}).ambiguous() is None


def test_cells_that_are_no_numbers_are_counted_and_missing_ones_are_not() -> None:
    assert signs({0: ["978", "1.011", "1500", "OL", ""]}).others == 0
    assert signs({0: ["on", "978", "3.3 V", ".", "1e3"]}).others == 4


@pytest.mark.parametrize(
    ("sign", "cell", "as_decimal", "as_thousands"),
    [(".", "1.011", "'.' (1.011)", "',' (1011)"), (",", "1,011", "',' (1.011)", "'.' (1011)")],
)
def test_the_refusal_says_what_each_sign_would_mean(
    sign: str, cell: str, as_decimal: str, as_thousands: str
) -> None:
    said = str(ambiguous_sign("p", cell, "978", sign, Location(Path("log.csv"), 6)))
    assert f"--decimal {as_decimal}, or --decimal {as_thousands}" in said


# --- missing values


@pytest.mark.parametrize(
    ("cells", "comment"),
    [
        (["# made by a logger"], True),
        (["  # made by a logger", "x"], True),
        (["#"], True),
        (["#", "on a Monday"], True),
        (["#", "time", "x"], False),  # the name of a column that counts rows
        (["# no", "time", "x"], True),
        *(([mark, "5"], False) for mark in ("#N/A", "#NV", "#DIV/0!", "#REF!")),
        (["5 #"], False),
        ([""], False),
        ([], False),
    ],
)
def test_a_row_is_a_comment_by_its_first_sign(cells: list[str], comment: bool) -> None:
    assert is_comment(cells) is comment


FLOAT32 = float(np.finfo(np.float32).max)
#: SCPI's infinity and "not a number" (IEEE 488.2), the largest numbers of two sizes, to fewer digits too
NUMBERS = [
    *(9.9e37, -9.9e37, 9.91e37, 1e30, -1e30, 1e31, -1e31, 1e37, -1e37, 1e38, -1e38),
    *(sign * value for value in (FLOAT32, 3.402823e38, 3.40282e38, 3.4e38) for sign in (1.0, -1.0)),
    *(float(np.finfo(float).max), float(np.finfo(float).min)),
]


def test_numbers_of_an_overload_and_texts_of_no_value_are_no_readings(tmp_path: Path) -> None:
    marks = [*map(repr, NUMBERS), *(text for text in NO_VALUE if text not in ("", "none", "None"))]
    rows = [f"{line},{mark}\n" for line, mark in enumerate(marks)]
    more = [f"{len(marks) + k},{20 + k}\n" for k in range(3 * len(marks))]
    (tmp_path / "log.csv").write_text("time [s],p [bar]\n" + "".join([*more[:5], *rows, *more[5:]]), "utf-8")
    values = read_table(tmp_path / "log.csv").columns[1].values
    assert np.isnan(values).sum() == len(marks)
    assert np.isnan(values[5 : 5 + len(marks)]).all()
