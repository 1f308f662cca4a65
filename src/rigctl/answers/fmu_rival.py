"""A comparison with an FMU in words."""

from __future__ import annotations

from functools import partial

from rigctl.analysis.fmu_rival import FmuRival
from rigctl.answers.blocks import Block, Column, Points, Sentence, Table
from rigctl.units import significant
from rigctl.wording import chance_text

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
    return [Sentence(statement(rival), main=True), Points.of("", [*missing, *own]), Table(columns, rows)]


def statement(rival: FmuRival) -> str:
    """One plain sentence."""
    exposure = "no fit saw them" if rival.held_out else "the model was fitted to them, the FMU was not"
    sure = f"sign test, {chance_text(rival.p_value)}"
    if not rival.decided:
        return (
            f"these {rival.records} records do not show which of the two is better ({exposure}): "
            f"{rival.name} is nearer in {rival.nearer} and {rival.model} in {rival.further} ({sure})"
        )
    one, other, count = rival.name, rival.model, rival.nearer
    if rival.further > rival.nearer:
        one, other, count = rival.model, rival.name, rival.further
    return f"{one} is nearer than {other} in {count} of {rival.records} records ({exposure}; {sure})"
