"""Maps the board's microseconds to the bench's clock.

A query of the board's time, sent at s and answered at r, shows that the board's clock read b at some time in
[s, r], an interval that is first shortened by the transmission time of the characters. Offset and rate follow
from these intervals by least squares weighted by the inverse square of their widths,
``t = h0 + rate·(b − b0)``. Errors are corrected by a change of the slope, never by a step, so that the
intervals between samples remain correct; the map steps only after a restart of the board.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

_ROLL_OVER = 1 << 32
_KEPT = 64  # number of time queries stored
_RATE_SPAN = 20.0  # s of queries needed for a rate
_RATE_LIMIT = 0.01  # tolerance of a ceramic resonator: 0.5 %
_CORRECTION_TIME = 5.0  # s over which an offset error is removed
_STEEPEST = 2e-3  # limit of the change of slope
_LOST_TRACK = 0.05  # s; a larger error is not drift
_RESTARTED = 1.0  # s; a larger error is not a delayed exchange either
_DOUBTFUL = 3  # consecutive exchanges after which they are accepted


@dataclass(frozen=True, slots=True)
class _Exchange:
    board: float  # s, unwrapped
    host: float  # s, middle of the interval
    half: float  # s, half of its width


class ClockMap:
    """Maps board time to bench time, both in s.

    Attributes
    ----------
    uncertainty: half-width of the interval of the true time for a time stamp of the board, s.
    behind: time that the board's clock, without a restart, has lost since the previous exchange, s, if `add`
        rejected the latest one; 0 if that one shows a restart. An emulated board loses time when its computer
        is suspended, and makes up for some of it later: negative.
    """

    def __init__(self) -> None:
        self._exchanges: deque[_Exchange] = deque(maxlen=_KEPT)
        self._last_us = 0
        self._board = 0.0
        self._b0 = self._h0 = 0.0
        self._rate = 1.0
        self._doubted = 0
        self.uncertainty = 0.0
        self.behind = 0.0

    def unwrap(self, board_us: int) -> float:
        """Return board time in s, unwrapped over the counter's roll-over every 71.6 min; the stamp must be
        less than half that period from the previous one."""
        step = (board_us - self._last_us) % _ROLL_OVER
        if step >= _ROLL_OVER // 2:
            step -= _ROLL_OVER
        time = self._board + step * 1e-6
        if step > 0:
            self._last_us, self._board = board_us, time
        return time

    def is_recent(self, board_us: int, span: float) -> bool:
        """Return whether a stamp is within `span` s of the newest one, as `unwrap` requires."""
        away = (board_us - self._last_us) % _ROLL_OVER
        return min(away, _ROLL_OVER - away) <= span * 1e6

    def to_host(self, board_us: int) -> float:
        """Return the bench time of a time stamp of the board, s."""
        return self._h0 + self._rate * (self.unwrap(board_us) - self._b0)

    def add(self, sent: float, board_us: int, received: float) -> bool:
        """Add an exchange; return False if the board was restarted, or its clock was stopped (`behind`).

        An exchange that contradicts the earlier ones only slightly is left out: a busy computer delays data.
        """
        if not self._exchanges:  # a board that has been on for more than half the period is not before zero
            self._last_us, self._board = board_us, board_us * 1e-6
        before, self.behind = self._board, 0.0
        board = self.unwrap(board_us)
        exchange = _Exchange(board, 0.5 * (sent + received), 0.5 * max(received - sent, 0.0))
        if self._exchanges:
            expected = self._h0 + self._rate * (board - self._b0)
            error = abs(expected - exchange.host) - exchange.half
            # More than drift. Up to `_RESTARTED` it may be one exchange that a busy computer has delayed: it
            # is left out, and believed only when `_DOUBTFUL` in a row say so. A larger error is believed at
            # once. That the board was restarted is seen from its own number, which begins at zero.
            if error > _LOST_TRACK:
                self._doubted += 1
                if not self._restarted(before, board_us, exchange):
                    self.behind = exchange.host - expected
                return error < _RESTARTED and self._doubted < _DOUBTFUL
        self._doubted = 0
        first = not self._exchanges
        self._exchanges.append(exchange)
        rate, host = self._fit(board)
        if first or len(self._exchanges) <= 8:  # no sample depends on it yet
            self._b0, self._h0, self._rate = board, host, rate
        else:
            now = self._h0 + self._rate * (board - self._b0)
            # The map goes on from where it is: only its slope changes, so that no sample is moved against the
            # one before.
            correction = (host - now) / _CORRECTION_TIME
            self._b0, self._h0 = board, now
            self._rate = rate + min(max(correction, -_STEEPEST), _STEEPEST)
        # The narrowest interval of late: a single fast exchange tells more than many slow ones.
        best = min(one.half for one in list(self._exchanges)[-16:])
        error = abs(self._h0 - host)
        self.uncertainty = best + error
        return True

    def _restarted(self, before: float, board_us: int, exchange: _Exchange) -> bool:
        """Return whether an exchange that fits none of the earlier ones shows that the board's clock began at
        zero; without a restart it has only changed its speed.

        Beyond half of the counter's period, the unwrapped time of a restart is later than that of before.
        """
        since = exchange.host - self._exchanges[-1].host
        return exchange.board < before or board_us * 1e-6 <= since + _LOST_TRACK

    def _fit(self, board: float) -> tuple[float, float]:
        """Return the rate, and the bench time at board time `board`, s."""
        exchanges = self._exchanges
        # Too short for a rate: the width of the intervals would be taken for drift.
        if board - exchanges[0].board < _RATE_SPAN:
            best = min(exchanges, key=lambda one: one.half)
            return 1.0, best.host + (board - best.board)
        # Centred on the weighted means: squares of board times of hours would cost the digits of the
        # microseconds.
        weights = [1.0 / max(one.half, 1e-5) ** 2 for one in exchanges]
        total = sum(weights)
        b = sum(w * one.board for w, one in zip(weights, exchanges, strict=True)) / total
        h = sum(w * one.host for w, one in zip(weights, exchanges, strict=True)) / total
        spread = sum(w * (one.board - b) ** 2 for w, one in zip(weights, exchanges, strict=True))
        product = sum(w * (one.board - b) * (one.host - h) for w, one in zip(weights, exchanges, strict=True))
        rate = min(max(product / spread, 1.0 - _RATE_LIMIT), 1.0 + _RATE_LIMIT)
        return rate, h + rate * (board - b)
