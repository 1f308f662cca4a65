"""Campaigns by name: the one that ships as an example, and the bare bench."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from rigctl.errors import RigctlError, unknown_name
from rigctl_validation.bench.campaign import Campaign, Scatter
from rigctl_validation.bench.parameters import BenchParameters, Sensors, Switching

#: the published campaign with sensor noise, a relief valve set to within 0.2 %, and four conditions repeated
_MEASURED: Final = Campaign(scatter=Scatter(setting=0.002), repeated=4)

RECIPES: Final[Mapping[str, Campaign]] = {
    # a worn spool: 8e-15 m^3 at each port, twice what a new one leaks at most; up to 3 mm of stroke when hot
    "unknown-bench": replace(_MEASURED, bench=BenchParameters(spool_leak=8e-15), seed=1),
    "textbook": replace(_MEASURED, seed=2),
}


def with_hidden(campaign: Campaign, hidden: Mapping[str, float]) -> Campaign:
    """The campaign with hidden effects of the bench, its sensors or its valve set to values in SI.

    Raises
    ------
    RigctlError
        there is no such parameter.
    """
    for name, value in hidden.items():
        if name in BenchParameters._fields:
            campaign = replace(campaign, bench=campaign.bench._replace(**{name: value}))
        elif name in Sensors._fields:
            campaign = replace(campaign, sensors=campaign.sensors._replace(**{name: value}))
        elif name in Switching._fields:
            campaign = replace(campaign, switching=campaign.switching._replace(**{name: value}))
        else:
            known = (*BenchParameters._fields, *Sensors._fields, *Switching._fields)
            raise unknown_name("secret", name, known)
    return campaign


def read_hidden(texts: list[str]) -> dict[str, float]:
    """Read ``name=value`` texts, values in SI.

    Raises
    ------
    RigctlError
        a text has another form.
    """
    values = {}
    for text in texts:
        name, equals, value = text.partition("=")
        try:
            values[name.strip()] = float(value)
        except ValueError:
            equals = ""
        if not equals:
            raise RigctlError(
                "--hide: not a pair", value=text, expected="name=value in SI, e.g. rod_leak=1e-15"
            )
    return values
