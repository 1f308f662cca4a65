"""A change of a model, and its effect on the error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

from rigctl.units import parse_unit

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

    rmse: Mapping[str, float]
    heldout_rmse: Mapping[str, float] = field(default_factory=dict)
    chi2_reduced: float | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)

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

        return ModelError(shown(rmse), shown(heldout_rmse), chi2_reduced, dict(units), shown(noise))

    def document(self) -> dict[str, Any]:
        """The JSON document."""
        return {
            "rmse": dict(self.rmse),
            "chi2_reduced": self.chi2_reduced,
            "heldout_rmse": dict(self.heldout_rmse),
            "units": dict(self.units),
            "noise": dict(self.noise),
        }

    @staticmethod
    def of_document(written: Mapping[str, Any]) -> ModelError:
        """The object that `document` describes; a figure that was not finite is left out."""
        return ModelError(
            rmse=_numbers(written["rmse"]),
            heldout_rmse=_numbers(written["heldout_rmse"]),
            chi2_reduced=written["chi2_reduced"],
            units={str(name): str(unit) for name, unit in written["units"].items()},
            noise=_numbers(written["noise"]),
        )


def _numbers(written: Mapping[str, float | None]) -> dict[str, float]:
    return {str(name): float(value) for name, value in written.items() if value is not None}


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
    effect: str = ""
    runs: tuple[str, ...] = ()
    hold_out: str = ""
    only: str = ""
    assume: tuple[str, ...] = ()
    before: ModelError | None = None
    after: ModelError | None = None
    note: str = ""

    def __str__(self) -> str:
        """In a few words, e.g. ``add piston_leakage``."""
        words = {"start": "first version", "fit": "fit", "set": "set by hand", "edit": "edited by hand"}
        return words.get(self.kind) or f"{self.kind} {self.effect}"

    def document(self) -> dict[str, Any]:
        """The JSON document."""
        return {
            "done": str(self),
            "kind": self.kind,
            "effect": self.effect or None,
            "runs": list(self.runs),
            "hold_out": self.hold_out or None,
            "only": self.only or None,
            "assume": list(self.assume),
            "before": self.before.document() if self.before else None,
            "after": self.after.document() if self.after else None,
            "note": self.note or None,
        }

    @staticmethod
    def of_document(written: Mapping[str, Any]) -> Change:
        """The object that `document` describes."""
        before, after = written["before"], written["after"]
        return Change(
            kind=written["kind"],
            effect=written["effect"] or "",
            runs=tuple(written["runs"]),
            hold_out=written["hold_out"] or "",
            only=written.get("only") or "",
            assume=tuple(written.get("assume") or ()),
            before=ModelError.of_document(before) if before else None,
            after=ModelError.of_document(after) if after else None,
            note=written["note"] or "",
        )
