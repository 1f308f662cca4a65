"""The effect on the readings as a plot."""

from __future__ import annotations

from pathlib import Path

from rigctl.effects.declaration import Effect
from rigctl.model.signature import Signature
from rigctl.model.signature_document import shown_change
from rigctl.report.figure_files import require_figure, write_figure
from rigctl.report.plot import Look, Panel, Plot, Trace
from rigctl.rig.rig import Rig


def write_effect_figure(signature: Signature, effect: Effect, path: Path, rig: Rig | None = None) -> Path:
    """Draw the change of every reading over the standard record into a PNG or SVG file.

    Raises
    ------
    RigctlError
        the file has another ending, an existing file is not a figure, or it cannot be written.
    """
    form = require_figure(path)
    panels = []
    for index, name in enumerate(signature.output_names):
        change, unit = shown_change(signature, index, rig)
        trace = Trace(name, signature.times, change, Look.LINE, index, unit, in_legend=False)
        panels.append(Panel(f"Δ {name.replace('_', ' ')}\n[{unit}]", (trace,)))
    plot = Plot(path.stem, f"{effect.name}: {effect.equation}", "time [s]", tuple(panels))
    return write_figure(plot, path.parent, form)
