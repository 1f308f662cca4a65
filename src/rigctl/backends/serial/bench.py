"""The bench on rigctl's own board, as the runner sees it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import TypeVar

from rigctl.backends.commands import check_command, driven_outputs
from rigctl.backends.errors import BackendLost, BenchTripped, OutOfReach
from rigctl.backends.protocol import CommandReceipt, Notice, Sample
from rigctl.backends.serial.board import Board, trip_causes
from rigctl.backends.serial.greeting import Greeting, greet
from rigctl.backends.serial.heartbeat import Heartbeat
from rigctl.backends.serial.intake import Intake
from rigctl.backends.serial.line import Line, Refused
from rigctl.backends.serial.port import Connect, NoAnswer, PortLost
from rigctl.backends.serial.reaching import reach
from rigctl.backends.serial.reconnection import Reconnection
from rigctl.backends.serial.translation import Translation
from rigctl.backends.serial.wiring import Wiring
from rigctl.clock import Clock
from rigctl.errors import ExitCode, RigctlError
from rigctl.rig import Rig

T = TypeVar("T")

HOST_SILENT = "host silent"  #: the trip that a host's coming ends
_REPORT = 0.5  # s for the board to report a switch


class SerialBench:
    """A `Backend` for rigctl's own board, on any `Port`.

    Parameters
    ----------
    rig: what channels and actuators there are.
    clock: what waits are counted on.
    connect: opens the port; called again when it was lost.
    wiring: what is connected where.
    kind: ``serial`` or ``emulated``, for the identity.
    baud: bits per second.
    patience: s for a board that starts anew when its port is opened.
    reconnect: s for a lost board to come back.
    clear_trips: whether trips that are latched from before are cleared when the bench is opened; see
        docs/decisions/0011-who-clears-a-trip.md.
    by_hand: told when the operator turns something, where the operator is emulated too.
    """

    timed = True
    without_host = "the board switches off by itself 1.5 s after it last heard of rigctl, if it still works"

    def __init__(
        self,
        rig: Rig,
        clock: Clock,
        connect: Connect,
        wiring: Wiring,
        *,
        kind: str,
        baud: int,
        patience: float = 5.0,
        reconnect: float = 30.0,
        clear_trips: bool = False,
        identity: Mapping[str, str] | None = None,
        by_hand: Callable[[str, float], None] | None = None,
    ) -> None:
        self.clock = clock
        self.identity: Mapping[str, str] = {"kind": kind, "name": rig.name, **(identity or {})}
        self._rig = rig
        self._connect = connect
        self._translation = Translation(rig, wiring)
        self._baud = baud
        self._patience = patience
        self._reconnection = Reconnection(
            clock, connect, lambda port: Greeting(Line(port, clock, baud), clock, patience), reconnect
        )
        self._clear_trips = clear_trips
        self._by_hand = by_hand
        self._board: Board | None = None
        self._opened = False
        self._rate = 0.0
        self._heartbeat: Heartbeat | None = None
        self._trip_told = False
        self._cut_off: set[str] = set()  # what was driven, or may have been, when contact was lost
        self._ends: dict[str, float] = {}  # pulses that are timed here
        self._intake = Intake(self._translation, clock)

    @property
    def outputs_read(self) -> frozenset[str]:
        """What the board reports with each sample."""
        return self._translation.reported

    @property
    def outputs_answered(self) -> frozenset[str]:
        """The board answers every command."""
        return driven_outputs(self._rig)

    # --- open and close -----------------------------------------------------------------------------------

    def open(self) -> None:
        """Reach the board, check what it is, make its outputs safe, and learn its clock."""
        with reach(self._connect) as port:
            self._begin(greet(Line(port, self.clock, self._baud), self.clock, self._patience))
        self._opened = True

    def close(self) -> None:
        """Make outputs safe where the board can still be reached, and let the port go."""
        board, self._board = self._board, None
        self._opened = False
        self._reconnection.drop()
        if board is None:
            return
        try:
            self._make_safe(board)
            board.ask("STRM 0")
        except (PortLost, Refused):
            pass  # its own watchdog switches it off
        board.line.port.close()

    # --- samples ------------------------------------------------------------------------------------------

    def start(self, rate: float) -> None:
        """Let the board sample at `rate` Hz from now on."""
        if not (math.isfinite(rate) and rate > 0.0):
            raise RigctlError("not a sampling rate", value=f"{rate:g} Hz", expected="e.g. '100 Hz'")
        if not 0.01 <= rate <= 2000.0:
            raise RigctlError(
                "the board cannot sample like this", value=f"{rate:g} Hz", expected="0.01 to 2000 Hz"
            )
        self._check_open()
        self._rate = rate
        with suppress(OutOfReach):  # a board that comes back begins its stream by itself
            self._carried_out(self._start_stream)
        self._intake.wanted = True

    def next_sample(self, timeout: float) -> Sample | None:
        """The next line of the stream as a sample, on the bench's clock."""
        self._check_open()
        deadline = self.clock.now() + timeout
        while not self._intake.samples:
            if self._intake.tripped:
                if not self._trip_told:  # the notice and the receipts of the trip are fetched first
                    self._trip_told = True
                    return None
                raise BackendLost(f"the board has tripped: {self._intake.tripped}")
            if self.clock.now() >= deadline:
                return None
            self._pump(deadline)
        return self._intake.samples.popleft()

    def take_receipts(self) -> list[CommandReceipt]:
        """Switches that the board made by itself: ends of pulses, trips."""
        taken, self._intake.receipts = self._intake.receipts, []
        return taken

    def take_notices(self) -> list[Notice]:
        """Gaps, damaged lines, trips, losses and returns of the line."""
        taken, self._intake.notices = self._intake.notices, []
        return taken

    # --- commands -----------------------------------------------------------------------------------------

    def command(self, actuator: str, value: float, *, duration: float | None = None) -> CommandReceipt:
        """Switch an actuator; the receipt has the time that the board stamped."""
        self._check_open()
        check_command(self._rig, actuator, value, duration)
        if self._rig.actuators[actuator].by == "operator":
            if self._by_hand is not None:
                self._by_hand(actuator, value)
            self._intake.commanded[actuator] = value
            return CommandReceipt(self.clock.now(), actuator, value)
        self._ends.pop(actuator, None)
        in_reach = self._board is not None
        try:
            receipt = self._carried_out(lambda board: self._switch(board, actuator, value, duration))
        except OutOfReach:
            if in_reach and value != self._resting().get(actuator):  # it may have been carried out
                self._cut_off.add(actuator)
            raise
        self._intake.commanded[actuator] = value
        if duration is not None and not self._translation.times_pulse(actuator, duration):
            self._ends[actuator] = receipt.time + duration
        return receipt

    def safe(self) -> None:
        """Switch everything off now."""
        self._check_open()
        self._ends.clear()
        if self._board is None:
            raise BackendLost(f"the bench cannot be reached: {self._reconnection.why}")
        try:
            self._make_safe(self._board)
            self._intake.take(self._board)
        except Refused as error:
            raise BackendLost(str(error)) from None
        except PortLost as error:
            self._lose(error)
            raise BackendLost(f"the bench cannot be reached: {error}") from None

    # --- inside -------------------------------------------------------------------------------------------

    def _check_open(self) -> None:
        if not self._opened:
            raise BackendLost("the bench is not open")

    def _begin(self, board: Board) -> None:
        """Take a board that has answered: safe, trips known, clock learnt."""
        known = self.identity.get("firmware")
        if known is not None and known != board.identity["firmware"]:
            raise RigctlError(
                "another board answers than before", value=board.identity["firmware"], expected=known
            )
        self._make_safe(board)
        board.ask("STRM 0")
        board.learn_clock(8)
        board.line.forget()
        self.identity = {**self.identity, **board.identity}
        self._intake.tripped, self._trip_told = "", False
        known_commands = dict.fromkeys(self._rig.actuators, 0.0) | self._intake.commanded
        self._intake.commanded = known_commands | self._resting()
        self._heartbeat = Heartbeat(board, self.clock)
        self._settle_trips(board)
        self._start_stream(board)
        self._board = board

    def _resting(self) -> dict[str, float]:
        return {name: float(value) for name, value in self._rig.safe_state.items()}

    def _make_safe(self, board: Board) -> None:
        board.ask("OUTP:SAFE", tries=2)  # within a second
        for text in self._translation.safe_texts():
            board.ask(text)

    def _settle_trips(self, board: Board) -> None:
        """A silence of the host is over once a host is there; every other trip waits for a person."""
        before = board.trips()
        if not before:
            return
        causes = ", ".join(trip_causes(before))
        if not (self._clear_trips or trip_causes(before) == [HOST_SILENT]):
            raise BenchTripped(causes)
        try:
            board.ask("SYST:TRIP:CLE")
        except Refused:
            raise RigctlError(
                f"the board has tripped, and the cause lasts: {causes}", exit_code=ExitCode.FAILED
            ) from None
        self._intake.notice("note", f"the board had tripped before: {causes}; cleared")

    def _start_stream(self, board: Board) -> None:
        rate = self._rate or self._rig.monitor_rate
        board.ask(f"STRM {rate:.3f}")
        self._intake.restart(board)

    def _pump(self, until: float) -> None:
        """Let time pass up to `until`, or until something arrived."""
        now = self.clock.now()
        for actuator in [name for name, end in self._ends.items() if end <= now]:
            del self._ends[actuator]
            with suppress(OutOfReach):  # a board that comes back is made safe before anything else
                self._intake.receipts.append(self.command(actuator, float(self._rig.safe_state[actuator])))
        board, heartbeat = self._board, self._heartbeat
        if board is None or heartbeat is None:
            self._try_again(until)
            return
        silence = max(0.1, 3.0 / (self._rate or self._rig.monitor_rate))
        try:
            heartbeat.beat(silent=now - self._intake.heard > silence)
            board.line.poll(min(until, heartbeat.due, *self._ends.values()))
            heartbeat.listen()
        except PortLost as error:
            self._lose(error)
            return
        self._intake.take(board)

    def _carried_out(self, action: Callable[[Board], T]) -> T:
        """Do something with the board, once; what a loss of contact has cut off is never made up for here."""
        board = self._board
        if board is None:
            raise OutOfReach(f"the board cannot be reached for the moment: {self._reconnection.why}")
        try:
            return action(board)
        except PortLost as error:
            self._lose(error)
            raise OutOfReach(f"contact with the board is lost: {error}") from None
        except Refused as error:
            raise RigctlError(str(error), hint=_why(board), exit_code=ExitCode.FAILED) from None

    def _lose(self, error: PortLost) -> None:
        """Contact is lost; what the board does by itself now is to switch off."""
        board, self._board = self._board, None
        damaged, kept = "", None
        if board is not None:
            self._intake.take(board)
            damaged = self._intake.damage_since_heard(board)
            if isinstance(error, NoAnswer):  # opening it again would restart an Uno, or let another host in
                kept = board.line.port
            else:
                board.line.port.close()
        self._cut_off |= self._driven()
        self._reconnection.begin(f"{error}{damaged}", kept)
        self._intake.notice("fault", f"contact with the board is lost: {error}{damaged}")

    def _try_again(self, until: float) -> None:
        """What can be done by bench time `until` to find the board again."""
        board = self._reconnection.attempt(until)
        if board is None:
            return
        try:
            self._begin(board)
        except (PortLost, Refused) as error:
            board.line.port.close()
            self._reconnection.why = str(error)
            return
        except BenchTripped as tripped:  # it can be reached, and be made safe, but does nothing any more
            self._board = board
            self._intake.tripped = tripped.causes
            self._reconnection.why = tripped.what
            self._intake.notice("alarm", tripped.what)
        except RigctlError as error:
            board.line.port.close()
            raise BackendLost(str(error)) from None
        lost_at, why = self._reconnection.since, self._reconnection.why
        now = self.clock.now()
        self._intake.notice("note", f"the board is back after {now - lost_at:.1f} s, outputs off")
        switched_off = sorted(self._cut_off)
        self._cut_off.clear()
        resting, half = self._resting(), 0.5 * (now - lost_at)  # when, is not known any better
        self._intake.receipts += [
            CommandReceipt(now - half, name, resting[name], half) for name in switched_off
        ]
        missing = self._intake.missing_since(lost_at, self._rate or self._rig.monitor_rate)
        self._intake.gap(missing, cause=why, switched_off=switched_off)

    def _driven(self) -> set[str]:
        """Actuators that are commanded to something else than their safe value."""
        resting = self._resting()
        return {name for name, value in self._intake.commanded.items() if resting.get(name, value) != value}

    def _switch(self, board: Board, actuator: str, value: float, duration: float | None) -> CommandReceipt:
        """Send a command and wait for the board to say when it was done."""
        self._intake.take(board)
        timed = duration is not None and self._translation.times_pulse(actuator, duration)
        by_itself = duration if timed else None
        text = self._translation.text(actuator, value, by_itself)
        board.ask(text, tries=1 if by_itself is not None else 3)
        kind = self._translation.event_kind(actuator)
        raw = self._translation.raw(actuator, value)
        deadline = self.clock.now() + _REPORT
        while True:
            while board.line.switched:
                event = board.line.switched.popleft()
                if (event.kind, event.value) == (kind, raw):
                    self._intake.take(board)
                    time = board.clock_map.to_host(event.board_us)
                    return CommandReceipt(time, actuator, value, board.clock_map.uncertainty)
                if event.kind != kind:  # of the same kind: the way there
                    self._intake.take_switched(board, event)
            if self.clock.now() >= deadline:
                raise NoAnswer(f"the board does not report '{text}'")
            board.line.poll(deadline)


def _why(board: Board) -> str | None:
    """What a refusal comes from, where a trip is behind it."""
    try:
        causes = trip_causes(board.trips())
    except PortLost:
        return None
    return f"The board has tripped: {', '.join(causes)}" if causes else None
