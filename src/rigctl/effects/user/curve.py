"""A measured curve in an effect file."""

from __future__ import annotations

from rigctl.effects.measured_curve import MeasuredCurve
from rigctl.effects.user.names import slot_type, term_types
from rigctl.effects.user.quantity import ReadQuantity, read_quantity
from rigctl.effects.user.schema import CurveField
from rigctl.effects.validity import ValidRange
from rigctl.errors import Location, RigctlError
from rigctl.physics.family import ModelFamily, Slot
from rigctl.physics.interpolation import Curve
from rigctl.units import parse_unit


def read_curve(
    field: CurveField, family: ModelFamily, slot: Slot, where: Location | None = None
) -> tuple[MeasuredCurve, ValidRange | None]:
    """The curve, and its measured range if the argument is one of the model's variables.

    Raises
    ------
    RigctlError
        the quantity is invalid or has another unit than the points, or the values another than the slot.
    """
    quantity = read_quantity(field.of, term_types(family, slot, ()), where)
    over, unit, wanted = parse_unit(field.over), parse_unit(field.unit), slot_type(slot)
    if over.dimension != quantity.type.dimension:
        raise RigctlError(
            f"the points of the curve have another unit than {quantity.text}",
            value=field.over,
            expected=quantity.type.wanted,
        )
    if unit.dimension != wanted.dimension:
        raise RigctlError(
            f"the values of the curve have another unit than the slot {slot.name}",
            value=field.unit,
            expected=f"{wanted}, as every {'factor' if slot.combine == 'product' else 'term'} there",
        )
    interval = quantity.difference
    x = tuple(over.to_si(point[0], difference=interval) for point in field.points)

    def values(given: list[float]) -> tuple[float, ...]:
        return tuple(unit.to_si(value, difference=True) for value in given)

    def through(y: tuple[float, ...]) -> Curve:
        return Curve("curve", field.over, field.unit, x, y, beyond=field.beyond)

    nothing = 1.0 if slot.combine == "product" else 0.0
    if all(y == nothing for _, y in field.points):
        raise RigctlError(f"the curve is {nothing:g} everywhere: it does nothing")
    low, high = values([one for one, _ in field.band]), values([one for _, one in field.band])
    half = tuple(0.5 * (b - a) for a, b in zip(low, high, strict=True))
    curve = MeasuredCurve(
        of=quantity.text,
        formula=quantity,
        curve=through(values([y for _, y in field.points])),
        low=low,
        high=high,
        half=through(half) if any(half) else None,
        factor=slot.combine == "product",
        difference=interval,
    )
    return curve, _range(quantity, field, family, x)


def _range(
    quantity: ReadQuantity, field: CurveField, family: ModelFamily, x: tuple[float, ...]
) -> ValidRange | None:
    """The range of the points; a slot's own variables are known only at the slot."""
    local = {name for slot in family.slots for name, _ in slot.local}
    if quantity.names & local:
        return None
    return ValidRange(quantity.text, field.over, x[0], x[-1], quantity, quantity.difference)
