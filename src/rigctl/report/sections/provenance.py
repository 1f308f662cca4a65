"""Where the numbers come from: files and their hashes, calibrations, versions, checksums."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rigctl.answers.numbers import symbol
from rigctl.report.run_data import RunData
from rigctl.report.section import Section, render
from rigctl.report.signals import plain_name


@dataclass(frozen=True)
class CalibrationRow:
    """The data of one sensor."""

    channel: str
    formula: str
    date: str
    uncertainty: str
    reference: str


@dataclass(frozen=True)
class RunProvenance:
    """The inputs of one run."""

    id: str
    hashes: tuple[tuple[str, str], ...]
    versions: tuple[tuple[str, str], ...]
    calibrations: tuple[CalibrationRow, ...]
    texts: tuple[tuple[str, str], ...]


def build(runs: Sequence[RunData]) -> Section:
    """Hashes, versions, calibrations, and the full text of the files."""
    body = render("provenance.html", runs=[_provenance(run) for run in runs], several=len(runs) > 1)
    hint = "calibrations, versions, checksums, the files word for word"
    return Section("provenance", "Where the numbers come from", body, folded=True, hint=hint)


def _provenance(run: RunData) -> RunProvenance:
    info = run.info
    sources = [(name, info.get(name) or {}) for name in ("procedure", "rig")]
    files = info.get("files") or {}
    hashes = [
        *(
            (f"{name} {source.get('path') or source.get('name', '')}", source["sha256"])
            for name, source in sources
            if source.get("sha256")
        ),
        *([("expanded plan", info["plan_digest"])] if info.get("plan_digest") else []),
        *((name, facts.get("sha256", "")) for name, facts in files.items()),
    ]
    versions = info.get("versions") or {}
    calibrations = info.get("calibrations") or {}
    return RunProvenance(
        id=run.id,
        hashes=tuple((name, str(value)) for name, value in hashes),
        versions=tuple((str(name), str(value)) for name, value in versions.items()),
        calibrations=tuple(
            _calibration(name, facts, run.signals[name].unit if name in run.signals else "")
            for name, facts in calibrations.items()
        ),
        texts=tuple((name, source["text"]) for name, source in sources if source.get("text")),
    )


def _calibration(name: str, facts: Mapping[str, Any], unit: str) -> CalibrationRow:
    calibration = facts.get("calibration") or {}
    return CalibrationRow(
        channel=plain_name(name),
        formula=formula(calibration.get("coefficients") or (), unit),
        date=str(calibration.get("date") or ""),
        uncertainty=_amount(calibration.get("uncertainty"), unit),
        reference=str(calibration.get("reference") or ""),
    )


def _amount(value: object, unit: str) -> str:
    """An interval as in the rig file: text with its unit, or a number in SI."""
    if isinstance(value, str):
        return value
    if isinstance(value, int | float) and unit:
        from rigctl.answers.numbers import amount
        from rigctl.units import parse_unit

        return amount(parse_unit(unit).from_si(float(value), difference=True), _interval(unit))
    return ""


def _interval(unit: str) -> str:
    """The unit of a difference: temperatures differ by kelvins."""
    return "K" if unit == "degC" else unit


def formula(coefficients: Sequence[float], unit: str) -> str:
    """The calibration polynomial as a formula: ``−12.5 + 0.1222·raw bar``; "" without one."""
    if not coefficients:
        return ""
    powers = ("", "·raw", "·raw²", "·raw³")
    terms = []
    for power, coefficient in enumerate(coefficients):
        suffix = powers[power] if power < len(powers) else f"·raw^{power}"
        if coefficient or len(coefficients) == 1:
            terms.append(f"{coefficient:g}{suffix}")
    text = " + ".join(terms).replace("+ -", "− ")
    return f"({text.replace('-', '−')}) {symbol(unit)}".rstrip()
