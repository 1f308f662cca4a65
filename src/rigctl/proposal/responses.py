"""How well simple linear systems explain a log, and with which values: where a draft's fit begins.

A lag, an oscillator, a driven mass and a straight line are all linear in everything but one or two numbers
(a time constant; a frequency and a damping). On a grid of these, the response to every input is one recursion
and the rest is linear least squares (variable projection: Golub & Pereyra, SIAM J. Numer. Anal. 10 (1973)
413), so that no start is needed and no local minimum is met: slow steps, resonances under a multisine and
free decays are found alike. Between samples an input is held, or a line if it is smooth.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.proposal.columns import Column, Floats, Table

#: samples of a log that are used: the first of each record
_MOST_SAMPLES = 3000
_FEWEST_SAMPLES = 8
#: a sensor that tells no directions leaves at most this share of what one that does leaves
_WITHOUT_SIGN = 0.6


@dataclass(frozen=True)
class Response:
    """A linear system fitted to an output.

    Attributes
    ----------
    rates: its poles' parameters: ``(1/T,)``, ``(w, zeta)``, ``(friction/mass,)``, or none.
    gains: of the inputs, SI: at rest, or of the acceleration for a driven mass.
    rest: the output at rest without input, SI.
    unexplained: share of the output's variance about its mean over all records.
    """

    rates: tuple[float, ...]
    gains: tuple[float, ...]
    rest: float
    unexplained: float


@dataclass(frozen=True)
class _Record:
    """A record at equal steps; `inputs` act from each sample to the next."""

    step: float
    y: Floats
    inputs: tuple[Floats, ...]

    @property
    def good(self) -> NDArray[np.bool_]:
        return np.isfinite(self.y)


#: for a record: the response to each input, and the record's own free motions
_Columns = Callable[[_Record], tuple[list[Floats], list[Floats]]]


def first_order_response(table: Table, y: Column, inputs: Sequence[Column]) -> Response | None:
    """``T·dy/dt = rest + Σ gain·u − y``; None if the log is too short."""
    records = _records(table, y, inputs)
    if not records:
        return None

    def fitted(rate: float) -> Response:
        return _fitted(records, (rate,), lambda record: _lag(record, rate))

    return _best(fitted(rate) for rate in _rates(records))


def second_order_response(table: Table, y: Column, inputs: Sequence[Column]) -> Response | None:
    """``y'' = w²·(rest + Σ gain·u − y) − 2·zeta·w·y'``; None if the log is too short."""
    records = _records(table, y, inputs)
    if not records:
        return None

    def fitted(omega: float, zeta: float) -> Response:
        return _fitted(records, (omega, zeta), lambda record: _oscillator(record, omega, zeta))

    return _on_grid(records, fitted)


def _on_grid(records: Sequence[_Record], fitted: Callable[[float, float], Response]) -> Response:
    """The best frequency and damping."""
    # A grid over what the records can show, then three finer ones about its best point: a resonance of light
    # damping is narrower than the spacing of the first.
    slow, fast = _ends(records)
    best = _best(
        fitted(float(omega), zeta)
        for omega in np.geomspace(slow, fast, 60)
        for zeta in (0.02, 0.1, 0.3, 0.7, 1.5, 4.0)
    )
    for spread in (1.12, 1.04, 1.01):  # a light damping has a narrow peak
        omega, zeta = best.rates
        near = (
            fitted(omega * spread**i, zeta * (1.0 + 10.0 * (spread - 1.0)) ** j)
            for i in range(-2, 3)
            for j in range(-2, 3)
        )
        best = _best([best, *near])
    return best


def tells_no_directions(table: Table, y: Column, inputs: Sequence[Column]) -> Response | None:
    """``y = gain·|z|``, z a second-order response to the input, if that explains a log much better than z.

    Both begin at rest, since a free motion of each record would take the place of its magnitude. None unless
    the output never is negative while its one input takes both signs.
    """
    if len(inputs) != 1 or not inputs[0].values.size or not y.values.size:
        return None
    low, high = float(np.nanmin(inputs[0].values)), float(np.nanmax(inputs[0].values))
    if not low < 0.0 < high or np.nanmin(y.values) < -0.02 * np.nanmax(np.abs(y.values)):
        return None
    records = _records(table, y, inputs)
    if not records:
        return None

    def signed(omega: float, zeta: float) -> Response:
        return _fitted(records, (omega, zeta), lambda record: (_oscillator(record, omega, zeta)[0], []))

    def unsigned(omega: float, zeta: float) -> Response:
        sizes = np.concatenate([np.abs(_oscillator(one, omega, zeta)[0][0])[one.good] for one in records])
        read = np.concatenate([record.y[record.good] for record in records])
        gain = float(sizes @ read) / (float(sizes @ sizes) or 1.0)
        left = float(np.sum((read - gain * sizes) ** 2)) / (_variation(records) or 1.0)
        return Response((omega, zeta), (gain,), 0.0, left)

    found = _on_grid(records, unsigned)
    return found if found.unexplained < _WITHOUT_SIGN * _on_grid(records, signed).unexplained else None


def driven_mass_response(table: Table, x: Column, inputs: Sequence[Column]) -> Response | None:
    """``x'' = rest + Σ gain·u − a·x'``, `rates` a; None if the log is too short, or nothing drives it."""
    records = _records(table, x, inputs)
    if not records or not inputs:
        return None

    def fitted(rate: float) -> Response:
        return _fitted(records, (rate,), lambda record: _mass(record, rate))

    return _best(fitted(rate) for rate in _rates(records))


def static_response(table: Table, y: Column, inputs: Sequence[Column]) -> Response | None:
    """``y = rest + Σ gain·u`` at once; None if the log is too short, or there is no input."""
    records = _records(table, y, inputs, held=True)
    if not records or not inputs:
        return None
    return _fitted(records, (), lambda record: ([*record.inputs, np.ones(record.y.size)], []))


def _records(table: Table, y: Column, inputs: Sequence[Column], *, held: bool = False) -> list[_Record]:
    """The first samples of every record, on equal steps."""
    if table.times is None or not y.values.size:
        return []
    pieces = [rows for rows in table.pieces if rows.size >= _FEWEST_SAMPLES]
    most = max(_FEWEST_SAMPLES, _MOST_SAMPLES // max(len(pieces), 1))
    found = []
    for rows in pieces:
        times = table.times[rows[:most]]
        steps = np.diff(times)
        if not (steps > 0.0).any():
            continue
        # the median step would drift away from times that were rounded
        typical, long = float(np.median(steps[steps > 0.0])), float(times[-1] - times[0])
        step = long / round(long / typical)
        even = times[0] + step * np.arange(min(round(long / step) + 1, 2 * most))
        values = _at(even, times, y.values[rows[:most]], held=False)
        acting = [
            _acting(_at(even, times, u.values[rows[:most]], held=u.stepped), held=held or u.stepped)
            for u in inputs
        ]
        if np.isfinite(values).sum() >= _FEWEST_SAMPLES:
            found.append(_Record(step, values, tuple(acting)))
    return found


def _at(even: Floats, times: Floats, values: Floats, *, held: bool) -> Floats:
    good = np.isfinite(values)
    if not good.any():
        return np.full(even.size, np.nan)
    if held:
        step = even[1] - even[0]
        last = np.clip(np.searchsorted(times[good], even + 0.01 * step, side="right") - 1, 0, None)
        return np.asarray(values[good][last])
    return np.interp(even, times[good], values[good])


def _acting(values: Floats, *, held: bool) -> Floats:
    """What acts from each sample to the next: the value, or the middle of a line."""
    values = np.nan_to_num(values)
    return values if held else np.append(0.5 * (values[1:] + values[:-1]), values[-1])


def _ends(records: Sequence[_Record]) -> tuple[float, float]:
    """The slowest and the fastest rate that the records may show, 1/s."""
    longest = max(record.step * record.y.size for record in records)
    shortest = min(record.step for record in records)
    return 1.0 / longest, 2.5 / shortest


def _rates(records: Sequence[_Record]) -> Iterator[float]:
    slow, fast = _ends(records)
    yield from (float(rate) for rate in np.geomspace(slow, fast, 160))


def _best(responses: Iterable[Response]) -> Response:
    return min(responses, key=lambda one: one.unexplained)


def _lag(record: _Record, rate: float) -> tuple[list[Floats], list[Floats]]:
    # Exact for an input that is held: y(n + 1) = p·y(n) + (1 − p)·u(n), p = exp(−h/T). The free motion pⁿ has
    # a size of its own in each record, which starts in an unknown state.
    pole = math.exp(-rate * record.step)
    driven = [_recursion([0.0, 1.0 - pole], [1.0, -pole], u) for u in record.inputs]
    return [*driven, np.ones(record.y.size)], [np.power(pole, np.arange(record.y.size))]


def _oscillator(record: _Record, omega: float, zeta: float) -> tuple[list[Floats], list[Floats]]:
    motion = _transition(np.array([[0.0, 1.0], [-(omega**2), -2.0 * zeta * omega]]), record.step)
    # at rest under a constant input the output is the input: B·u = (I − A)·[1, 0]·u
    push = (np.eye(2) - motion) @ np.array([1.0, 0.0])
    return _second(record, motion, push, np.ones(record.y.size))


def _mass(record: _Record, rate: float) -> tuple[list[Floats], list[Floats]]:
    decay = math.exp(-rate * record.step)
    gone = -math.expm1(-rate * record.step) / rate
    motion = np.array([[1.0, gone], [0.0, decay]])
    push = np.array([(record.step - gone) / rate, gone])
    return _second(record, motion, push, None)


def _second(
    record: _Record, motion: Floats, push: Floats, rest: Floats | None
) -> tuple[list[Floats], list[Floats]]:
    """Responses of two states, of which the first is read, and its two free motions; without a `rest` a
    constant push takes its place."""
    # x(n + 1) = A·x(n) + B·u(n), read by its first state: as one recursion of the output, by the
    # characteristic polynomial of A (Cayley-Hamilton).
    trace, determinant = float(np.trace(motion)), float(np.linalg.det(motion))
    below = [1.0, -trace, determinant]
    above = [0.0, float(push[0]), float(motion[0, 1] * push[1] - motion[1, 1] * push[0])]
    driven = [_recursion(above, below, u) for u in record.inputs]
    driven.append(_recursion(above, below, np.ones(record.y.size)) if rest is None else rest)
    once = np.zeros(record.y.size)
    once[0] = 1.0
    free: list[Floats] = [
        _recursion([1.0, -float(motion[1, 1])], below, once),
        _recursion([0.0, 1.0], below, once),
    ]
    return driven, free


def _transition(matrix: Floats, step: float) -> Floats:
    from scipy.linalg import expm

    return np.asarray(expm(matrix * step))


def _recursion(above: Sequence[float], below: Sequence[float], values: Floats) -> Floats:
    """``Σ below[k]·y(n − k) = Σ above[k]·u(n − k)``: a banded triangular system."""
    from scipy.linalg import solve_banded

    pushed = np.zeros(values.size)
    for k, factor in enumerate(above):
        pushed[k:] += factor * values[: values.size - k]
    bands = np.array(below)[:, None] * np.ones(values.size)
    return np.asarray(solve_banded((len(below) - 1, 0), bands, pushed, check_finite=False))


def _fitted(records: Sequence[_Record], rates: tuple[float, ...], columns: _Columns) -> Response:
    """Least squares for the gains and the rest; the free motions of each record are taken out first."""
    # Normal equations over all records: [driven columns, y]ᵀ[driven columns, y] with each record's free
    # motions projected off, so that long logs need no tall matrix.
    products: Floats | float = 0.0
    for record in records:
        driven, free = columns(record)
        products = products + _without(record, driven, free)
    total = _variation(records)
    square, right = np.asarray(products)[:-1, :-1], np.asarray(products)[:-1, -1]
    size = np.sqrt(np.diag(square))
    size[size == 0.0] = 1.0
    scaled, *_ = np.linalg.lstsq(square / np.outer(size, size), right / size, rcond=1e-10)
    left = float(np.asarray(products)[-1, -1] - scaled @ (right / size))
    *gains, level = (float(one) for one in scaled / size)
    return Response(rates, tuple(gains), level, max(left, 0.0) / (total or 1.0))


def _without(record: _Record, driven: Sequence[Floats], free: Sequence[Floats]) -> Floats:
    """The products of the driven columns and the output, less what the free motions explain of them."""
    good = record.good
    matrix = np.column_stack([*driven, record.y])[good]
    if free:
        basis, size = np.linalg.qr(np.column_stack(free)[good])
        shown = np.abs(np.diag(size)) > 1e-9 * np.abs(np.diag(size)).max(initial=1e-300)
        matrix = matrix - basis[:, shown] @ (basis[:, shown].T @ matrix)
    return np.asarray(matrix.T @ matrix)


def _variation(records: Sequence[_Record]) -> float:
    """Sum of squares of the output about its mean over all records."""
    every = np.concatenate([record.y[record.good] for record in records])
    return float(np.sum((every - every.mean()) ** 2))
