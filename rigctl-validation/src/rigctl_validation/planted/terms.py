"""Terms of the separate bench that are in no library, and acceptable answers of a search for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from rigctl.errors import unknown_name
from rigctl_validation.hidden_effect import HiddenEffect


@dataclass(frozen=True)
class PlantedTerm:
    """A term of one field of `Bench` or `Sensors`.

    Attributes
    ----------
    name: of the field, where it is described.
    slots: the location, and others at which a term has the same signature.
    forms: keys of the formula, without the slot: ``bump of position``.
    typical: amplitude at which the search starts, SI; up to a thousand times as much is tried.
    signs: physically possible directions.
    """

    name: str
    slots: tuple[str, ...]
    forms: tuple[str, ...]
    typical: float
    signs: tuple[int, ...] = (1,)

    @property
    def variables(self) -> frozenset[str]:
        """The states and inputs on which it depends, as its first form has them."""
        arguments = [factor.split(" of ", 1)[1] for factor in self.forms[0].split(" times ")]
        return frozenset(name for argument in arguments for name in argument.split(" - "))

    @property
    def hidden(self) -> HiddenEffect:
        """In the form in which the bench hides it."""
        return HiddenEffect(
            effect=self.name,
            parameter="size",
            typical=self.typical,
            largest=1e3 * self.typical,
            amounts=partial(_amounts, self.name),
        )


def _amounts(name: str, amplitude: float) -> dict[str, float]:
    return {name: amplitude}


def _dry(size: str) -> tuple[str, ...]:
    """The forms of a dry force whose size is a function of a variable: the bench rounds its sign over 2 mm/s,
    as the sign without a scale of its own does."""
    return f"{size} times tanh of velocity", f"{size} times sign of velocity"


_FORCE = ("friction", "load")
_FROM_A, _FROM_P = ("flow_a_to_tank",), ("flow_p_to_tank",)

PLANTED: tuple[PlantedTerm, ...] = (
    PlantedTerm("groove", _FORCE, ("bump of position",), 50.0),
    PlantedTerm("scuff", _FORCE, _dry("bump of position"), 50.0),
    PlantedTerm("tight", _FORCE, ("bump of position times linear of velocity",), 50.0),
    PlantedTerm("cushion", _FORCE, ("above of position times linear of velocity",), 100.0),
    PlantedTerm("cold_seal", _FORCE, _dry("decay of oil_temperature"), 50.0),
    PlantedTerm("half_drag", _FORCE, ("power_half of velocity",), 50.0),
    PlantedTerm("cube_drag", _FORCE, ("power_three of velocity",), 50.0),
    PlantedTerm(
        "bent_rod",
        _FORCE,
        (*_dry("linear of position"), "tanh of velocity times even_one of position"),
        50.0,
    ),
    PlantedTerm("rubber", _FORCE, ("growth of position",), 100.0),
    PlantedTerm("grip", _FORCE, ("stribeck of velocity",), 50.0),
    PlantedTerm("diaphragm", _FORCE, ("power_two of pressure_a",), 50.0, (1, -1)),
    PlantedTerm(
        "score",
        ("flow_a_to_b",),
        ("bump of position times linear of pressure_a - pressure_b",),
        1e-7,
    ),
    PlantedTerm("nozzle_a", _FROM_A, ("power_half of pressure_a",), 1e-7),
    PlantedTerm("nozzle_b", ("flow_b_to_outside", "flow_b_to_tank"), ("power_half of pressure_b",), 1e-7),
    PlantedTerm("crack_a", _FROM_A, ("above of pressure_a",), 1e-7),
    PlantedTerm("lip_a", _FROM_A, ("power_two of pressure_a",), 1e-7),
    PlantedTerm("lip_ab", ("flow_a_to_b",), ("power_two of pressure_a - pressure_b",), 1e-7),
    PlantedTerm("lip_p", _FROM_P, ("power_two of supply_pressure",), 1e-6),
    PlantedTerm("warm_slip", _FROM_P, ("linear of oil_temperature times even_one of supply_pressure",), 1e-6),
    PlantedTerm("dented_scale", ("position_reading",), ("bump of position",), 1e-4, (1, -1)),
    PlantedTerm("root_scale", ("position_reading",), ("power_half of position",), 1e-4, (1, -1)),
    PlantedTerm(
        "soft_transducer", ("supply_pressure_reading",), ("power_two of supply_pressure",), 1e4, (1, -1)
    ),
)


def find_planted(name: str) -> PlantedTerm:
    """The term called `name`.

    Raises
    ------
    RigctlError
        there is none; the message gives the nearest name.
    """
    names: Sequence[str] = [one.name for one in PLANTED]
    if name not in names:
        raise unknown_name("planted term", name, names)
    return PLANTED[names.index(name)]
