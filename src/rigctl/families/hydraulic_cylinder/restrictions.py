"""Flow through the valves: turbulent restrictions, in series with one another and with a laminar line.

Every function is smooth over all pressures and openings, with the corners of ``sqrt`` and ``max`` rounded
far below what a bench resolves: a fit needs derivatives at rest, where pressures are equal and edges closed.
"""

from __future__ import annotations

import math

from rigctl.engine.symbols import Scalar, absolute, positive_part, sqrt
from rigctl.physics.scope import Scope

#: pressure difference below which the square root is rounded, in Pa
ROOT_WIDTH = 1e3
#: opening of the spool below which an edge counts as closed; it then passes about 0.01 mm^3/s at 50 bar
OPENING_WIDTH = 1e-8


def conductance(discharge_coefficient: Scalar, area: Scalar, density: Scalar) -> Scalar:
    """``K = Cd * A * sqrt(2 / rho)``, so that ``Q = K * sqrt(dp)``.

    Source: Merritt, Hydraulic Control Systems (1967), section 3-4.
    """
    return discharge_coefficient * area * sqrt(2.0 / density)


def series(first: Scalar, second: Scalar) -> Scalar:
    """``K1 * K2 / sqrt(K1^2 + K2^2)``: two turbulent restrictions, one behind the other.

    `second` must not be zero.
    """
    return first * second / sqrt(first * first + second * second)


def restricted_flow(
    conductance: Scalar, pressure_drop: Scalar, resistance: Scalar = 0.0, turbulence: Scalar = 0.0
) -> Scalar:
    """The flow Q that solves ``|dp| = (1/K^2 + turbulence) * Q^2 + resistance * |Q|``, with the sign of dp.

    Without a line it is ``Q = K * dp / sqrt(|dp|)``; the root is rounded below `ROOT_WIDTH`.

    Parameters
    ----------
    conductance: K in m^3/(s*sqrt(Pa)).
    pressure_drop: dp in Pa.
    resistance: of a laminar line in series, in Pa*s/m^3.
    turbulence: of bends and fittings in series, in Pa*s^2/m^6.
    """
    # With 1/k² = 1/K² + turbulence this is the quadratic Q²/k² + R·Q = |dp|, whose positive root is Q =
    # 2k·|dp|/(R·k + √((R·k)² + 4·|dp|)). In this form, other than in −R·k + √(…), nothing cancels when the
    # laminar line dominates, and dp in place of |dp| in the numerator gives the sign without a branch.
    k = conductance / sqrt(1.0 + conductance * conductance * turbulence)
    magnitude = absolute(pressure_drop, ROOT_WIDTH)
    laminar = resistance * k
    return 2.0 * k * pressure_drop / (laminar + sqrt(laminar * laminar + 4.0 * magnitude))


def opening_extend(m: Scope) -> Scalar:
    """Relative opening of the edges P-A and B-T: the positive part of the spool's position."""
    return positive_part(m.spool, OPENING_WIDTH)


def opening_retract(m: Scope) -> Scalar:
    """Relative opening of the edges P-B and A-T."""
    return positive_part(-m.spool, OPENING_WIDTH)


def throttle_conductance(m: Scope, pressure_drop: Scalar) -> Scalar:
    """Conductance of the flow-control valve, whose area effects may change."""
    area = m.flow_area * m.factor("throttle_area", reynolds=throttle_reynolds(m, pressure_drop))
    return conductance(m.discharge_coefficient, area, m.density)


def throttle_reynolds(m: Scope, pressure_drop: Scalar) -> Scalar:
    """``Re = w * d / nu`` of the ideal jet: ``w = sqrt(2 * |dp| / rho)``, d the diameter of a round throttle.

    The pressure drop is that of the whole path, of which the valve edge in series accounts for about 1 %, so
    that Re need not be solved for.
    """
    diameter = sqrt(4.0 / math.pi * m.flow_area)
    jet = sqrt(2.0 * absolute(pressure_drop, ROOT_WIDTH) / m.density)
    return jet * diameter * m.density / m.viscosity


def path_flow(m: Scope, opening: Scalar, pressure_drop: Scalar, *, throttled: bool) -> Scalar:
    """Flow in m^3/s through one edge of the directional valve, of area ``A_e * opening``, and its line.

    With `throttled`, the flow-control valve is in series too.
    """
    path = conductance(m.discharge_coefficient, m.edge_area * opening, m.density)
    if throttled:
        path = series(path, throttle_conductance(m, pressure_drop))
    return restricted_flow(path, pressure_drop, m.total("line_resistance"), m.total("line_turbulence"))
