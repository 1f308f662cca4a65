"""Logs and rig files with which no verdict can be right: each must be refused, or be 'not decided'."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final, Literal, TypeAlias

import numpy as np

from rigctl_validation.benches.bench import Floats
from rigctl_validation.moving_benches.campaign import MovingCampaign, write_moving

Spoiled: TypeAlias = Literal[
    "",
    "a reading that is constant",
    "a reading of two values",
    "converter steps of five sigmas, 28 records",
    "twelve rows",
    "blocks of missing values",
    "a channel that is its own input",
    "a stated noise of zero",
    "a stated noise in another quantity",
    "a stated noise in another unit",
]
#: with these a model without a hidden effect may be called adequate; a missing effect may not be claimed
ADEQUATE_IS_RIGHT: Final = frozenset(
    ("converter steps of five sigmas, 28 records", "blocks of missing values")
)

_RECORDS, _ROWS = 28, 100
_FEW = 12
#: missing values come in blocks of this many rows, every other block
_BLOCK = 25
_OWN_INPUT = """\
family: copied_reading
title: A reading that is compared with itself

inputs:
  {name}: {{value: 0 {unit}}}

parameters:
  gain: {{value: "1", bounds: ["0.1", "10"]}}

outputs:
  {name}: {{unit: {unit}, formula: gain*{name}}}
"""
_OWN_MODEL = """\
model: family.yaml
rig: rig.yaml
parameters:
  gain: {value: "1", fit: true}
"""


def write_spoiled(campaign: MovingCampaign, spoiled: Spoiled, folder: Path) -> Path:
    """Write a user's folder with this fault; returns the path of the log."""
    table = campaign.table(0.0)
    records: list[Mapping[str, Floats]] = [table]
    (channel, sigma), *_ = campaign.twin.bench.noise.items()
    if spoiled == "a reading that is constant":
        table[channel] = np.full_like(table[channel], float(np.median(table[channel])))
    elif spoiled == "a reading of two values":
        low, high = np.quantile(table[channel], (0.2, 0.8))
        table[channel] = np.where(table[channel] > np.median(table[channel]), high, low)
    elif spoiled == "converter steps of five sigmas, 28 records":
        records = [_converted(replace(campaign, record=k), 5.0) for k in range(_RECORDS)]
    elif spoiled == "twelve rows":
        records = [{name: column[:_FEW] for name, column in table.items()}]
    elif spoiled == "blocks of missing values":
        missing = np.arange(table[channel].size) // _BLOCK % 2 == 1
        table[channel] = np.where(missing, np.nan, table[channel])
    log = write_moving(campaign, records, folder)
    if spoiled == "a channel that is its own input":
        unit = campaign.twin.bench.columns[channel]
        text = _OWN_INPUT.format(name=channel, unit=unit)
        (folder / "family.yaml").write_text(text, encoding="utf-8", newline="\n")
        (folder / "model.yaml").write_text(_OWN_MODEL, encoding="utf-8", newline="\n")
    stated = _stated(campaign, channel, sigma).get(spoiled)
    if stated is not None:
        rig = folder / "rig.yaml"
        text = rig.read_text(encoding="utf-8")
        text = re.sub(rf"^(  {channel}: {{.*)}}$", rf"\1, noise: {stated}}}", text, flags=re.MULTILINE)
        rig.write_text(text, encoding="utf-8", newline="\n")
    return log


def _converted(campaign: MovingCampaign, steps: float) -> Mapping[str, Floats]:
    """A short record whose converters have steps of that many sigmas."""
    table = {name: column[:_ROWS] for name, column in campaign.table(0.0).items()}
    for name, sigma in campaign.twin.bench.noise.items():
        table[name] = np.round(table[name] / (steps * sigma)) * steps * sigma
    return table


def _stated(campaign: MovingCampaign, channel: str, sigma: float) -> dict[Spoiled, str]:
    unit = campaign.twin.bench.columns[channel]
    return {
        "a stated noise of zero": f"0 {unit}",
        "a stated noise in another quantity": f"{sigma:.4g} mol",
        "a stated noise in another unit": f"{1000.0 * sigma:.4g} {unit}",
    }
