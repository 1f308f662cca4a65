"""The compiled types of the two kernels that Python calls."""

from __future__ import annotations

from typing import Any

from numba import types

_int, _float = types.int64, types.float64
_ints, _floats = types.Array(_int, 1, "C"), types.Array(_float, 1, "C")
_int_table, _table = types.Array(_int, 2, "C"), types.Array(_float, 2, "C")
_given = types.Array(_float, 1, "C", readonly=True)
_given_table = types.Array(_float, 2, "C", readonly=True)
_cube = types.Array(_float, 3, "C")

#: of `record.integrate_record`
RECORD: Any = types.Tuple([_int, _float, _int])(
    _ints,  # addresses
    _ints,  # sizes
    _floats,  # tolerance
    _given,  # y0
    _given,  # q
    _given,  # command_times
    _given_table,  # command_values
    _given_table,  # command_shifts
    _given,  # knots
    _given_table,  # ramps
    _ints,  # ramped
    _given,  # sample_times
    _ints,  # initial_columns
    _ints,  # delayed
    _int_table,  # rhs_active
    _int_table,  # outputs_active
    _int_table,  # delays_active
    _table,  # spline_weights
    _table,  # spline_knots
    _int_table,  # rhs_splines
    _floats,  # rhs_scales
    _int_table,  # outputs_splines
    _floats,  # outputs_scales
    _int_table,  # delays_splines
    _floats,  # delays_scales
    _floats,  # floats
    _ints,  # integers
    _table,  # states
    _table,  # outputs
    _cube,  # sensitivities
    _ints,  # counters
)

#: of `step.step_to`
STEP: Any = types.Tuple([_int, _float])(
    _ints,  # addresses
    _ints,  # sizes
    _floats,  # tolerance
    _given,  # q
    _float,  # target
    _floats,  # commanded
    _floats,  # carried
    _ints,  # delayed
    _floats,  # floats
    _ints,  # integers
    _floats,  # outputs
    _ints,  # counters
)
