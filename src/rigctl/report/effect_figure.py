"""The effect on the readings as a plot."""

from __future__ import annotations

from pathlib import Path

from rigctl.dataset.outputs import is_figure, require_output
from rigctl.effects.declaration import Effect
from rigctl.errors import RigctlError
from rigctl.model.signature import Signature
from rigctl.report.figure_files import FORMATS, write_figure
from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.rig.rig import Rig
from rigctl.units import interval_unit, parse_unit

#: units of readings without a rig file
_SHOWN = {"Pa": "bar", "m": "mm", "m^2/s": "cSt"}


def shown_unit(output: str, unit: str, rig: Rig | None) -> str:
    """The unit in which a change of an output is shown; temperatures change by kelvins."""
    wanted = rig.channels[output].unit if rig is not None else _SHOWN.get(unit, unit)
    return interval_unit(wanted)


def write_effect_figure(signature: Signature, effect: Effect, path: Path, rig: Rig | None = None) -> Path:
    """Draw the change of every reading over the standard record into a PNG or SVG file.

    Raises
    ------
    RigctlError
        the file has another ending, an existing file is not a figure, or it cannot be written.
    """
    form = path.suffix.lstrip(".").casefold()
    if form not in FORMATS:
        raise RigctlError(
            "not a format of figures",
            value=path.name,
            expected=f"a name ending in {' or '.join(f'.{each}' for each in FORMATS)}",
        )
    require_output(path, replaces=is_figure, option="")
    panels = []
    for index, (name, si) in enumerate(zip(signature.output_names, signature.output_units, strict=True)):
        unit = shown_unit(name, si, rig)
        change = signature.difference[:, index] / parse_unit(unit).factor
        trace = Trace(name, signature.times, change, Look.LINE, index, unit, in_legend=False)
        panels.append(Panel(f"Δ {name.replace('_', ' ')}\n[{unit}]", (trace,)))
    plot = Plot(path.stem, f"{effect.name}: {effect.equation}", "time [s]", tuple(panels))
    return write_figure(plot, path.parent, form)
