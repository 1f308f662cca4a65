"""The published viscosity of HL32, and the deviations of a law from it."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from rigctl.files.shipped import shipped
from rigctl.files.unit_table import heading_parts
from rigctl.units import parse_unit


@dataclass(frozen=True)
class PublishedPoint:
    """One printed row, in SI: K, m^2/s, Pa*s."""

    temperature: float
    kinematic_measured: float
    kinematic_vogel: float
    dynamic_measured: float
    dynamic_vogel: float


@dataclass(frozen=True)
class Misfit:
    """A law compared with one measured value, in SI.

    `error` is ``(measured - law) / law``: positive if the oil is more viscous than predicted by the law.
    """

    temperature: float
    measured: float
    law: float

    @property
    def error(self) -> float:
        """``(measured - law) / law``."""
        return (self.measured - self.law) / self.law


def published_viscosity() -> tuple[PublishedPoint, ...]:
    """The printed table of HL32 from 20 to 80 degC at atmospheric pressure, read from the shipped CSV.

    Source: Hashim, Al-Salihi & Al Zubaidi; see ``data/README.md``.
    """
    text = shipped("data", "hl32-viscosity.csv").read_text(encoding="utf-8")
    header, *rows = csv.reader(text.splitlines())
    units = [parse_unit(heading_parts(cell)[1]) for cell in header]
    return tuple(
        PublishedPoint(*(unit.to_si(float(cell)) for unit, cell in zip(units, row, strict=True)))
        for row in rows
    )


def misfit(law: Callable[[float], float], measured: Iterable[tuple[float, float]]) -> tuple[Misfit, ...]:
    """Compare ``law(T)`` with measured pairs (T in K, value); one row each, in the given order."""
    return tuple(Misfit(temperature, value, law(temperature)) for temperature, value in measured)


def largest_misfit(rows: Sequence[Misfit]) -> Misfit:
    """The row with the largest relative error, of either sign."""
    return max(rows, key=lambda row: abs(row.error))
