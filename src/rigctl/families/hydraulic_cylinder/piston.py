"""The piston: forces and end stops; and the spool of the directional valve."""

from __future__ import annotations

from rigctl.engine.symbols import Scalar, positive_part, smooth_step
from rigctl.physics.scope import Scope

#: rounding of the end stop's force law, m: 0.2 N at 1 mm before the stop
CONTACT_WIDTH = 2e-6


def valve_delay(m: Scope, before: Scalar, after: Scalar) -> Scalar:
    """Delay from the command to the action of the solenoids, in s: 0 unless an effect adds to it."""
    return m.total("valve_delay", before=before, after=after)


def spool_rate(m: Scope) -> Scalar:
    """``(command - u) / tau``: the spool follows the solenoids with a first-order lag."""
    return (m.valve - m.spool) / m.spool_time


def position_rate(m: Scope) -> Scalar:
    """The velocity."""
    return m.velocity


def friction(m: Scope) -> Scalar:
    """Force against the motion: ``b * v`` plus the terms of effects."""
    return m.viscous_damping * m.velocity + m.total("friction")


def load(m: Scope) -> Scalar:
    """Force against extension: the rig's constant load plus the terms of effects."""
    return m.load_force + m.total("load")


def end_stops(m: Scope) -> Scalar:
    """Force of the stops at 0 and at full stroke on the piston: spring and damper during contact."""
    before_start = -m.position
    beyond_end = m.position - m.stroke
    # Only one stop is touched at a time, so both share a formula: the spring pushes inwards by its
    # compression, and the damper acts while there is contact, in either direction of motion.
    spring = positive_part(before_start, CONTACT_WIDTH) - positive_part(beyond_end, CONTACT_WIDTH)
    touching = smooth_step(before_start, CONTACT_WIDTH) + smooth_step(beyond_end, CONTACT_WIDTH)
    return m.end_stop_stiffness * spring - m.end_stop_damping * touching * m.velocity


def velocity_rate(m: Scope) -> Scalar:
    """``(A_A*pA - A_B*pB - load - friction + end stops) / m``."""
    pressure_force = m.area_a * m.pressure_a - m.area_b * m.pressure_b
    mass = m.moving_mass + m.total("mass")
    return (pressure_force - m.load - m.friction + m.end_stops) / mass
