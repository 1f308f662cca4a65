"""The differences between two models, or two versions of one."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from rigctl.errors import RigctlError
from rigctl.model.model import Model
from rigctl.model.value_table import StatedValue, stated_values


@dataclass(frozen=True)
class ValueDifference:
    """A value that differs; None if a model does not have it. Both are in the same unit."""

    name: str
    before: StatedValue | None
    after: StatedValue | None

    @property
    def change(self) -> float | None:
        """``(after - before)/before``; None if undefined."""
        if self.before is None or self.after is None or self.before.si == 0.0:
            return None
        return (self.after.si - self.before.si) / self.before.si

    @property
    def deviations(self) -> float | None:
        """``|after - before|/sqrt(s1^2 + s2^2)``, s being their standard deviations as far as known."""
        if self.before is None or self.after is None:
            return None
        spread = math.hypot(self.before.std or 0.0, self.after.std or 0.0)
        return abs(self.after.si - self.before.si) / spread if spread > 0.0 else None


@dataclass(frozen=True)
class ModelDifference:
    """The changes from `before` to `after`.

    Attributes
    ----------
    added, removed: effects.
    values: of parameters that differ in value, in uncertainty, or in whether a fit may change them.
    fields: other fields of the file that differ, with their old and new contents.
    """

    before: Model
    after: Model
    added: tuple[str, ...]
    removed: tuple[str, ...]
    values: tuple[ValueDifference, ...]
    fields: tuple[tuple[str, str, str], ...]

    @property
    def same(self) -> bool:
        """Whether the two models are identical."""
        return not (self.added or self.removed or self.values or self.fields)


def difference(before: Model, after: Model) -> ModelDifference:
    """The changes from `before` to `after`.

    Raises
    ------
    RigctlError
        they are of different families, which cannot be compared.
    """
    if before.family.name != after.family.name:
        raise RigctlError(
            "models of different families cannot be compared",
            value=f"{before.family.name} and {after.family.name}",
        )
    return ModelDifference(
        before=before,
        after=after,
        added=tuple(name for name in after.effects if name not in before.effects),
        removed=tuple(name for name in before.effects if name not in after.effects),
        values=_values(before, after),
        fields=tuple(
            (field, old, new)
            for field, old, new in (
                ("rig", _rig(before), _rig(after)),
                ("oil", before.oil or "", after.oil or ""),
                ("description", before.description, after.description),
            )
            if old != new
        ),
    )


def _rig(model: Model) -> str:
    return model.rig.name if model.rig is not None else ""


def _values(before: Model, after: Model) -> tuple[ValueDifference, ...]:
    old = {stated.name: stated for stated in stated_values(before)}
    new = {stated.name: stated for stated in stated_values(after)}
    differences = []
    for name in dict.fromkeys((*old, *new)):
        was, now = old.get(name), new.get(name)
        if was is not None and now is not None:
            if _same(was, now):
                continue
            # both in the unit of the new one, so that the two numbers can be compared
            was = replace(was, unit=now.unit)
        differences.append(ValueDifference(name, was, now))
    return tuple(differences)


def _same(one: StatedValue, other: StatedValue) -> bool:
    """Equal up to the rounding of unit conversions."""
    return (
        math.isclose(one.si, other.si, rel_tol=1e-12)
        and one.fit == other.fit
        and one.prior == other.prior
        and math.isclose(one.std or 0.0, other.std or 0.0, rel_tol=1e-12)
    )
