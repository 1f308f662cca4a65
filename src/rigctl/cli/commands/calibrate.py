"""`rigctl calibrate`: reference values and raw readings become a channel's calibration in the rig file.

In: points from the bench and an operator, from a CSV file, or from the records of a run. Out: the rig
file with new coefficients, and beside it the file as it was, the points and a figure of the residuals.
Taking the points is in `rigctl.runner.calibrate`, the fit in `rigctl.rig.calibration_fit`, the change of
the file in `rigctl.rig.calibration_file`; this module puts them in order and words the result.

The fit is shown before anything is written, and a terminal is asked. Without one (a script, `--json`) it
is written at once; `--dry` is for those who only want to see it.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, date, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rigctl.cli.commands.manual import Backend, RigFile, Speed
from rigctl.cli.echo import echo, print_json
from rigctl.cli.options.as_json import Json
from rigctl.cli.options.driver import AllowDriverOption
from rigctl.cli.options.port import PortOption
from rigctl.cli.question import confirm
from rigctl.errors import RigctlError, unknown_name
from rigctl.units import significant

if TYPE_CHECKING:
    from rigctl.rig import Channel, Rig
    from rigctl.rig.calibration_fit import CalibrationFit, Point


def calibrate(
    channel: Annotated[str, typer.Argument(help="Name in the rig file.", show_default=False)],
    rig: RigFile = None,
    points: Annotated[
        Path | None,
        typer.Option(help="CSV file 'reference [unit],raw' instead of the bench.", show_default=False),
    ] = None,
    run: Annotated[
        str | None,
        typer.Option(
            metavar="RUN", help="Run whose records hold the reference values, instead of the bench."
        ),
    ] = None,
    against: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="With --run: answer or measure that is the reference."),
    ] = None,
    degree: Annotated[
        int, typer.Option(min=1, max=5, help="Degree of the polynomial: 1 for a line, 2 for a parabola, …")
    ] = 1,
    readings: Annotated[int, typer.Option(min=1, help="Samples at each reference value.")] = 20,
    reference: Annotated[
        str | None, typer.Option(help="Reference instrument, e.g. 'dead-weight tester'.")
    ] = None,
    reference_uncertainty: Annotated[
        str | None, typer.Option(help="Uncertainty of the reference values, 95 %, e.g. '0.05 bar'.")
    ] = None,
    valid_for: Annotated[str | None, typer.Option(help="Period of validity, e.g. '365 day'.")] = None,
    day: Annotated[
        str | None, typer.Option("--date", help="Date of the calibration; by default today.")
    ] = None,
    backend: Backend = None,
    port: PortOption = None,
    allow_driver: AllowDriverOption = None,
    speed: Speed = "1x",
    rate: Annotated[
        float | None, typer.Option(min=0.01, help="Sampling rate in Hz; by default that of the rig file.")
    ] = None,
    *,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Write without asking.")] = False,
    dry: Annotated[bool, typer.Option("--dry", help="Fit and show, but write nothing.")] = False,
    as_json: Json = False,
) -> None:
    """Calibrate a channel: read it while you apply known values, and fit a line or polynomial.

    The new coefficients are written to the rig file with date and uncertainty; everything else in it,
    including comments, is unchanged. The previous file, the points and a figure of the residuals are kept in
    'calibrations/' beside it. Reference values come from the keyboard, from stdin (one per line), from
    --points together with the raw readings, or from the records of a run, e.g. of
    'procedures/calibrate-pressure.yaml'.

    Examples:

      rigctl calibrate supply_pressure --reference "dead-weight tester, class 0.05" --valid-for "365 day"

      rigctl calibrate supply_pressure --points points.csv --dry

      rigctl calibrate supply_pressure --run latest --against reference_pressure
    """
    from rigctl.cli.attended_run import typing_possible
    from rigctl.cli.commands.manual import open_rig
    from rigctl.cli.options.quantities import read_option
    from rigctl.rig.calibration_fit import fit_calibration
    from rigctl.rig.calibration_points import read_points
    from rigctl.units import read_si

    if (points is not None) + (run is not None) > 1:
        raise RigctlError("points come from one source", value="--points and --run", expected="one of them")
    if against is not None and run is None:
        raise RigctlError("--against needs a run", expected="--run RUN")
    bench = open_rig(rig)
    if channel not in bench.channels:
        raise unknown_name("channel", channel, bench.channels)
    part = bench.channels[channel]
    on = _date(day)
    if valid_for is not None:
        read_option("--valid-for", valid_for, "s", above_zero=True)
    of_reference = 0.0
    if reference_uncertainty:
        given = read_option(
            "--reference-uncertainty", reference_uncertainty, part.unit, difference=True, above_zero=True
        )
        of_reference = part.display.from_si(read_si(given, part.unit, difference=True), difference=True)
    taken: Sequence[Point]
    if points is not None:
        taken = read_points(points, part)
    elif run is not None:
        taken = _from_run(bench, channel, run, against)
    else:
        taken = _from_bench(bench, channel, backend, port, speed, rate, readings)
    fit = fit_calibration(part, taken, degree, reference_uncertainty=of_reference)
    document = _as_document(channel, part, fit, on)
    if not as_json:
        _show(channel, part, fit)
    if not dry and (yes or as_json or not typing_possible() or confirm("Write it to the rig file?")):
        document |= _write(bench, channel, fit, on, reference, valid_for)
    _finish(document, as_json=as_json)


def _from_run(rig: Rig, channel: str, run: str, against: str | None) -> Sequence[Point]:
    from rigctl.dataset import open_run
    from rigctl.runner.calibrate import points_of_run

    if against is None:
        raise RigctlError(
            "which value of the records is the reference?", expected="e.g. '--against reference_pressure'"
        )
    return points_of_run(open_run(run), rig, channel, against)


def _date(written: str | None) -> date:
    if written is None:
        return datetime.now(UTC).astimezone().date()
    try:
        return date.fromisoformat(written)
    except ValueError:
        raise RigctlError("--date: no date", value=written, expected="e.g. 2026-03-14") from None


def _from_bench(
    rig: Rig,
    channel: str,
    backend: str | None,
    port: Sequence[str] | None,
    speed: str,
    rate: float | None,
    readings: int,
) -> Sequence[Point]:
    """Take the points; messages for the operator go to stderr."""
    from rigctl.cli.commands.manual import access_of
    from rigctl.runner.calibrate import take_points
    from rigctl.runner.operators.console import Console

    how = access_of(rig, backend, port, speed)
    with Console("operator") as console:
        return take_points(
            rig,
            channel,
            how,
            console,
            readings=readings,
            rate=rate or rig.monitor_rate,
            report=lambda text: echo(f"  {text}", err=True),
        )


def _write(
    rig: Rig, channel: str, fit: CalibrationFit, day: date, reference: str | None, valid_for: str | None
) -> dict[str, Any]:
    """Write rig file, points and figure; returns their paths."""
    from rigctl.files.write import write_text
    from rigctl.report.calibration_figure import calibration_plot
    from rigctl.report.figure_files import write_figure
    from rigctl.rig.calibration_file import calibration_entries, with_calibration, write_calibration
    from rigctl.rig.calibration_points import write_points

    part = rig.channels[channel]
    entries = calibration_entries(part, fit, day, reference, valid_for)
    written = write_calibration(rig, with_calibration(rig, channel, entries), datetime.now(UTC))
    stem = written.backup.with_suffix("").name
    table = written.backup.with_name(f"{stem}.{channel}.csv")
    write_text(table, write_points(fit.points, part))
    title = f"{rig.name}: {channel}, {day.isoformat()}, {reference or 'reference not named'}"
    plot = calibration_plot(channel, part, fit, title)
    drawn = write_figure(plot, written.backup.parent)
    figure = drawn.replace(table.with_suffix(".png"))
    return {
        "written": True,
        "rig": str(written.rig),
        "backup": str(written.backup),
        "points_file": str(table),
        "figure": str(figure),
        "entries": entries,
    }


def _as_document(name: str, channel: Channel, fit: CalibrationFit, day: date) -> dict[str, Any]:
    """The result for programs; field names are part of the interface."""
    return {
        "channel": name,
        "unit": channel.unit,
        "raw_unit": channel.raw_unit,
        "date": day,
        "degree": fit.degree,
        "coefficients": fit.coefficients,
        "std": fit.std,
        "residual_std": fit.residual_std,
        "uncertainty": fit.uncertainty,
        "curvature_p_value": fit.curvature_p_value,
        "largest_change": fit.largest_change(channel.calibration.coefficients),
        "points": [
            {
                "reference": point.reference,
                "raw": point.mean,
                "scatter": point.scatter,
                "readings": len(point.raw),
                "residual": residual,
            }
            for point, residual in zip(fit.points, fit.residuals, strict=True)
        ],
        "remarks": _remarks(channel, fit),
        "written": False,
    }


def _remarks(channel: Channel, fit: CalibrationFit) -> list[str]:
    """Warnings about the calibration."""
    unit, remarks = channel.unit, []
    if fit.residual_std is None:
        remarks.append(
            f"{len(fit.points)} points determine {len(fit.coefficients)} coefficients exactly: none is left "
            "to check the curve; take more"
        )
    if fit.bent:
        remarks.append(f"the points are curved: --degree {fit.degree + 1} fits significantly better")
    if channel.range is not None:
        low, high = (
            channel.display.from_si(float(end), difference=channel.difference) for end in channel.range
        )
        values = [point.reference for point in fit.points]
        if max(values) - min(values) < 0.5 * (high - low):
            remarks.append(
                f"calibrated from {min(values):g} to {max(values):g} {unit}; the channel may read {low:g} to "
                f"{high:g} {unit}, and beyond the points the curve is extrapolated"
            )
    return remarks


def _show(name: str, channel: Channel, fit: CalibrationFit) -> None:
    from rigctl.report.calibration_figure import residual_lines
    from rigctl.rig.calibration_fit import interval

    for line in residual_lines(channel, fit):
        echo(line)
    terms = ("", f"·{channel.raw_unit}", *(f"·{channel.raw_unit}^{k}" for k in range(2, 8)))
    formula = " ".join(
        f"{value:+.7g}{term}" for value, term in zip(fit.coefficients, terms, strict=False)
    ).removeprefix("+")
    echo(f"{name} [{channel.unit}] = {formula}")
    spread = (
        f", residuals {significant(interval(channel, fit.residual_std), 3)}"
        if fit.residual_std is not None
        else ""
    )
    change = interval(channel, fit.largest_change(channel.calibration.coefficients))
    unit = channel.interval_unit
    echo(
        f"uncertainty {significant(interval(channel, fit.uncertainty), 3)} {unit} (95 %{spread}); "
        f"up to {significant(change, 3)} {unit} from the calibration before"
    )
    for remark in _remarks(channel, fit):
        echo(f"note: {remark}")


def _finish(document: dict[str, Any], *, as_json: bool) -> None:

    if as_json:
        print_json(document)
    elif document["written"]:
        echo(f"written to {document['rig']}; before it: {document['backup']}")
        echo(f"points: {document['points_file']}")
        echo(f"figure: {document['figure']}")
    else:
        echo("nothing written")
