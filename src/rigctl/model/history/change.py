"""A change of a model, and its effect on the error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import BeforeValidator, PlainSerializer, TypeAdapter

from rigctl.units import parse_unit

#: a text that is null in a file where it is empty
Note: TypeAlias = Annotated[
    str, BeforeValidator(lambda text: text or ""), PlainSerializer(lambda text: text or None)
]
#: names, none in versions that were written before the field was
Names: TypeAlias = Annotated[tuple[str, ...], BeforeValidator(lambda names: names or ())]
#: figures by channel; one that was not finite is null in a file, and left out
Figures: TypeAlias = Annotated[
    Mapping[str, float],
    BeforeValidator(lambda figures: {name: value for name, value in figures.items() if value is not None}),
]
Kind: TypeAlias = Literal["start", "fit", "add", "remove", "set", "edit"]


@dataclass(frozen=True)
class ModelError:
    """The error of a model.

    Attributes
    ----------
    rmse: root mean square error of each channel, in its unit of `units`, on the records it was fitted to.
    heldout_rmse: the same on the records that were held out; empty when none were.
    chi2_reduced: squared error in units of the noise, per degree of freedom.
    noise: the standard deviation of each channel's noise, if known: the lower limit of the error.
    """

    rmse: Figures
    chi2_reduced: float | None = None
    heldout_rmse: Figures = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    noise: Figures = field(default_factory=dict)

    @staticmethod
    def from_si(
        rmse: Mapping[str, float],
        units: Mapping[str, str],
        *,
        heldout_rmse: Mapping[str, float] | None = None,
        chi2_reduced: float | None = None,
        noise: Mapping[str, float] | None = None,
    ) -> ModelError:
        """The figures of channels in `units`, from those in SI."""

        def shown(si: Mapping[str, float] | None) -> dict[str, float]:
            return {name: value / parse_unit(units[name]).factor for name, value in (si or {}).items()}

        return ModelError(shown(rmse), chi2_reduced, shown(heldout_rmse), dict(units), shown(noise))

    def document(self) -> dict[str, Any]:
        """The JSON document."""
        document: dict[str, Any] = _ERROR.dump_python(self, mode="json")
        return document


_ERROR: Final = TypeAdapter(ModelError)


@dataclass(frozen=True)
class Change:
    """The change that made a version of a model from the previous one.

    Attributes
    ----------
    kind: "start" is the first version of a file, "set" has values set by hand, "edit" was edited by hand.
    effect: the one added or removed.
    runs, only, hold_out: the runs used for the fit, and the conditions that selected records from them (all
        if empty) and held records out.
    assume: ``name=value`` of inputs that these runs themselves do not contain.
    before, after: the error of the model before and after the change, on the same records.
    note: further remarks.
    """

    kind: Kind
    effect: Note = ""
    runs: Names = ()
    hold_out: Note = ""
    only: Note = ""
    assume: Names = ()
    before: ModelError | None = None
    after: ModelError | None = None
    note: Note = ""

    def __str__(self) -> str:
        """In a few words, e.g. ``add piston_leakage``."""
        words = {"start": "first version", "fit": "fit", "set": "set by hand", "edit": "edited by hand"}
        return words.get(self.kind) or f"{self.kind} {self.effect}"

    def document(self) -> dict[str, Any]:
        """The JSON document."""
        return {"done": str(self), **CHANGE.dump_python(self, mode="json")}


#: a change as it is written into a version's file, and read back
CHANGE: Final = TypeAdapter(Change)
