"""How well a calibration fits: its curve and points and, below, the residuals; as a file and as text."""

from __future__ import annotations

from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.rig import Channel
from rigctl.rig.calibration import polynomial
from rigctl.rig.calibration_fit import CalibrationFit, interval

_HALF = 14  # characters on either side of zero
_ROUNDING = 1e-12  # share of the largest reference below which a residual counts as zero


def calibration_plot(name: str, channel: Channel, fit: CalibrationFit, title: str) -> Plot:
    """Reference over raw value with the fitted curve, and the residuals over the same axis."""
    import numpy as np

    unit, between = channel.unit, channel.interval_unit
    x = np.array([point.mean for point in fit.points])
    grid = np.linspace(x.min(), x.max(), 201)
    curve = np.array([polynomial(fit.coefficients, float(at)) for at in grid])
    reference = np.array([point.reference for point in fit.points])
    residuals = np.array([interval(channel, value) for value in fit.residuals])
    half = interval(channel, fit.uncertainty)
    order = np.argsort(x, kind="stable")
    ends = np.array([x.min(), x.max()])
    band = tuple(
        Trace("uncertainty, 95 %", ends, np.full(2, sign * half), colour=7, faint=True, unit=between,
              in_legend=sign > 0)
        for sign in (1.0, -1.0)
    )  # fmt: skip
    return Plot(
        id=f"calibration-{name}",
        caption=title,
        x_title=f"raw value [{channel.raw_unit}]",
        panels=(
            Panel(
                f"{name} [{unit}]",
                (
                    Trace("fitted", grid, curve, unit=unit),
                    Trace("points", x[order], reference[order], look=Look.POINTS, colour=1, unit=unit),
                ),
                height=1.6,
            ),
            Panel(
                f"residual [{between}]",
                (
                    Trace("residual", x[order], residuals[order], look=Look.POINTS, colour=1, unit=between),
                    *band,
                ),
            ),
        ),
    )


def residual_lines(channel: Channel, fit: CalibrationFit) -> list[str]:
    """A line for each point: reference, raw value, residual, and its position around zero."""
    unit, raw, between = channel.unit, channel.raw_unit, channel.interval_unit
    tiny = _ROUNDING * max(abs(point.reference) for point in fit.points)
    residuals = [interval(channel, value) if abs(value) > tiny else 0.0 for value in fit.residuals]
    largest = max(map(abs, residuals))
    lines = [f"{f'reference [{unit}]':>17}  {f'raw [{raw}]':>13}  {f'residual [{between}]':>16}"]
    lines += [
        f"{point.reference:17.6g}  {point.mean:13.6g}  {residual:16.3g}  {_strip(residual, largest)}"
        for point, residual in zip(fit.points, residuals, strict=True)
    ]
    return lines


def _strip(value: float, largest: float) -> str:
    """A dot where `value` lies between ``-largest`` and ``largest``, zero in the middle."""
    cells = [" "] * (2 * _HALF + 1)
    cells[_HALF] = "│"
    cells[_HALF + (round(value / largest * _HALF) if largest > 0.0 else 0)] = "●"
    return "".join(cells)
