"""A comparison with an FMU in words."""

from __future__ import annotations

from functools import partial

from rigctl.analysis.fmu_rival import FmuRival
from rigctl.answers.blocks import Block, Column, Points, Sentence, Table
from rigctl.units import significant

_three = partial(significant, digits=3)


def rival_blocks(rival: FmuRival) -> list[Block]:
    """The errors of an FMU and of the model, channel by channel, and which is smaller."""
    rows = tuple(
        {"channel": name, "fmu": error.nrmse, "model": rival.beside[name].nrmse}
        for name, error in rival.channels.items()
    )
    columns = (
        Column("channel", "channel"),
        Column("fmu", "RMSE/noise of the FMU", _three),
        Column("model", "of the model", _three),
    )
    missing = [f"{name} is not an output of {rival.name}: it is not compared" for name in rival.missing]
    own = [
        f"the initial value of {name} cannot be set in {rival.name}: its own is used"
        for name in rival.own_initial_values
    ]
    return [Sentence(rival.statement, main=True), Points.of("", [*missing, *own]), Table(columns, rows)]
