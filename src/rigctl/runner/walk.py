"""Walks a plan: one generator that yields what the step in progress waits for.

In: the tree of a `Plan` (groups, loops, branches, records, steps), and the bench. Out: a stream of `Until`
conditions for `rigctl.runner.main_loop`, which resumes it with a row, or throws an `Ending` into it.

An ending propagates as an exception from the step through the groups around it, and each group runs the
cleanup that belongs to it on the way (`_unwind`), from the inside out. Outputs are already safe by then:
whoever raises an ending calls `secure` first. Two exceptions do not end the run: `Restart` begins a step
again after a pause, and `SamplesLost` begins a record again where its `retries`, or the return of a lost
device, allow it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import count

from rigctl.plan import Branch, Group, Leaf, Loop, Node, Plan, RecordNode, Visitor, iteration_path
from rigctl.plan.behaviour import CHECKPOINT, OnPause, Until, Waiting, every_sample
from rigctl.plan.outcomes import DeviceBack, Ending, Lost, Outcome, SamplesLost, StepFailed, Tripped
from rigctl.runner.bench import Bench
from rigctl.runner.completeness import Completeness, worst
from rigctl.runner.progress import Progress
from rigctl.runner.remaining_plan import record_paths, remaining, setup_before
from rigctl.runner.sampling import Sampling
from rigctl.runner.step_errors import ending_for

#: longest time of one step of a cleanup block after a failure, s of bench time
CLEANUP_STEP_LIMIT = 60.0
#: how often one record is measured, or one step begun, again because a device was lost and is back
_MOST_RETURNS = 5


class Restart(Exception):
    """Restart the step in progress after a pause; `lost`: which a lost device was the reason for."""

    def __init__(self, *, lost: bool = False) -> None:
        super().__init__()
        self.lost = lost


class Walker(Visitor[Waiting]):
    """Carries out a plan on a bench.

    Parameters
    ----------
    secure: brings outputs to the safe state because of an ending, before any cleanup block runs.
    finish: called when all steps are done and only the procedure's `finally` is left.
    completed: paths of records that an earlier session has completed.
    """

    def __init__(
        self,
        bench: Bench,
        progress: Progress,
        sampling: Sampling,
        *,
        secure: Callable[[Ending], None],
        finish: Callable[[], None],
        completed: frozenset[str] = frozenset(),
    ) -> None:
        self._bench = bench
        self._progress = progress
        self._sampling = sampling
        self._secure = secure
        self._finish = finish
        self._completed = completed
        self._rounds: list[tuple[Loop, int]] = []
        self._again = False  # the record in progress will be repeated if samples are lost
        self._repeating = False  # inside `_repeated`
        self._waits = any(device.lost == "pause" for device in bench.rig.devices.values())
        self._spare = {name for name, one in bench.rig.devices.items() if one.lost == "continue"}
        self._hopeless = False  # no further cleanup block can be carried out
        self.limit = math.inf  #: deadline of the step in progress, s
        self.baseline: dict[str, float] = {}  #: commands at the start of the step in progress

    def plan(self, plan: Plan) -> Waiting:
        """Carry out the whole plan.

        Raises
        ------
        Ending
            what ended it early, after every cleanup block.
        """
        ending: Ending | None = None
        try:
            yield from self.group(plan.root)
            self._finish()
        except Ending as error:
            ending = error
        yield from self._unwind(plan.on_failure, plan.on_abort, plan.finally_, ending)
        if ending is not None:
            raise ending

    # --- groups ------------------------------------------------------------------------------------------

    def group(self, group: Group) -> Waiting:
        """Carry out its nodes one after the other, then the cleanup that applies to their end."""
        ending: Ending | None = None
        nodes: Sequence[Node] = group.children
        if self._completed:
            nodes = remaining(nodes, self._done)
            for node in group.children:
                if node not in nodes:
                    self._progress.skip(node)
        try:
            for index, node in enumerate(nodes):
                # `not self._repeating`: the record itself may be wrapped in a group for its cleanup blocks,
                # which is visited inside `_repeated`; only the outermost one repeats, so that a repetition
                # includes that cleanup.
                record = _record_in(node)
                if record is not None and not self._repeating and (record.retries or self._waits):
                    yield from self._repeated(nodes, index, record.retries)
                else:
                    yield from self.visit(node)
        except Ending as error:
            ending = error
        yield from self._unwind(group.on_failure, group.on_abort, group.finally_, ending)
        if ending is not None:
            raise ending

    def _unwind(
        self, on_failure: Group | None, on_abort: Group | None, last: Group | None, ending: Ending | None
    ) -> Waiting:
        """The cleanup blocks that apply to an ending, or to success."""
        # Three kinds of end: success and a repetition run `finally` alone, as ordinary steps, whose failure
        # is one of the run; any other ending runs `on_failure` or `on_abort` and then `finally`, as cleanup.
        repeated = isinstance(ending, DeviceBack) or (isinstance(ending, SamplesLost) and self._again)
        if ending is None or repeated:  # the run goes on: what ends it in here must not be passed over
            if last is not None:
                yield from self.group(last)
            return
        for block in (on_abort if ending.aborted else on_failure, last):
            if block is not None:
                yield from self._cleanup(block)

    def _cleanup(self, block: Group) -> Waiting:
        """Carry out every step of a cleanup block, each limited in time, even if earlier ones fail."""
        for node in block.children:
            # Each remaining step is still noted, so that the log shows what was not done.
            if self._hopeless or not self._bench.reachable:
                self._bench.event("note", f"cleanup step left out: {node.label}")
                continue
            self.limit = self._bench.now + CLEANUP_STEP_LIMIT
            try:
                yield from self.visit(node)
            except Ending as ending:
                # A step that fails stops none of the next; a trip, or the loss of the bench, stops all
                # further cleanup, in the groups around this one too: driving outputs is what has become
                # dangerous, or impossible.
                self._hopeless = isinstance(ending, Tripped | Lost)
                self._bench.event("note", f"cleanup step failed: {node.label}: {ending.reason}")
            finally:
                self.limit = math.inf

    def loop(self, loop: Loop) -> Waiting:
        """Carry out its body repeatedly, while its condition holds."""
        bench = self._bench
        for number in count(1):
            if loop.count is not None and number > loop.count:
                return
            # Evaluated before each round, on a reading taken after the last command: an older row shows the
            # bench as it was before the body changed it.
            if loop.condition is not None:
                yield from self._checkpoint(loop)
                row = yield from bench.fresh(loop.condition.names)
                if not bench.condition(loop.condition)(row):
                    return
            if number > loop.max_iterations:
                raise self._fail(loop, f"the loop has not ended after {loop.max_iterations} rounds")
            # The path of a record has the numbers of the rounds around it: that is how a resumed run knows
            # which are done.
            self._rounds.append((loop, number))
            try:
                # In a resumed run a round whose records are all complete is left out, its other steps too.
                paths = record_paths(loop.body) if self._completed else []
                if not paths or not all(self._done(path) for path in paths):
                    yield from self.group(loop.body)
            finally:
                self._rounds.pop()

    def branch(self, branch: Branch) -> Waiting:
        """Carry out one of its branches, according to the newest sample."""
        bench = self._bench
        yield from self._checkpoint(branch)
        row = yield from bench.fresh(branch.condition.names)
        holds = bool(bench.condition(branch.condition)(row))
        bench.event("step", branch.label, state="decided", outcome=str(holds).lower())
        chosen = branch.then if holds else branch.otherwise
        if chosen is not None:
            yield from self.group(chosen)

    def _checkpoint(self, node: Node) -> Waiting:
        """Let a pause begin before a decision; after it outputs are as they were left by the steps before."""
        self._bench.path = self._path(node.path)
        # What a pause restores; a decision has no commands of its own.
        self.baseline = dict(self._bench.commanded)
        yield CHECKPOINT

    # --- steps -------------------------------------------------------------------------------------------

    def leaf(self, leaf: Leaf) -> Waiting:
        """Carry out its action; any failure makes the outputs safe before anything else."""
        bench = self._bench
        bench.path = path = self._path(leaf.path)
        self._progress.begin(leaf.path, leaf.label, bench.now)
        bench.log(bench.now, "step", path=path, message=leaf.label, state="begin")
        # Taken before anything is commanded: a pause or a loss later in the step restores this, and the step,
        # as it begins again, commands the rest itself.
        self.baseline, returns = dict(bench.commanded), 0
        try:
            # Requests and samples that are due are handled between any two steps, however short they are.
            yield CHECKPOINT
            while True:
                try:
                    outcome = yield from leaf.action.carry_out(bench)
                    # A step is over when the bench has answered its last command, so that a refusal is
                    # attributed to it.
                    yield from bench.settled()
                    break
                except Restart as restart:
                    returns += restart.lost
                    if returns > _MOST_RETURNS:
                        raise _lost_too_often(leaf) from None
                    bench.event("note", "the step begins again after a pause")
        # Also an ending that the main loop has thrown in: `secure` does nothing a second time for the same
        # ending.
        except Exception as error:  # noqa: BLE001 - whatever it is, outputs become safe and cleanup runs
            ending = ending_for(error, bench)
            # The innermost step names the place in the procedure; groups around it must not replace it.
            ending.where = ending.where or leaf.where
            bench.event("step", f"{leaf.label}: {ending.reason}", state="end", outcome=ending.outcome.value)
            self._secure(ending)
            raise ending from None
        bench.log(bench.now, "step", path=path, state="end", outcome=outcome.value)
        self._progress.end(bench.now)

    def record(self, node: RecordNode) -> Waiting:
        """Open the record, carry out its body, close it with its outcome."""
        bench, path = self._bench, self._path(node.path)
        bench.path = path
        if path in self._completed:
            bench.event("step", node.label, state="end", outcome=Outcome.SKIPPED.value)
            return
        outcome = Outcome.FAILED
        try:
            self._open(node, path)
            # From here on until the record is closed lost samples raise `SamplesLost`, which `_repeated`
            # catches.
            self._sampling.repeatable = self._again
            # The first sample at the record's rate, before the first step acts: the record begins with the
            # initial state.
            yield Until(when=every_sample, on_pause=OnPause.DEFER)
            yield from self.group(node.body)
            # Samples that are due still belong to the record; then it is counted.
            yield CHECKPOINT
            # Inside the `try`, while the record is open: if it lacks too much, it is closed as interrupted,
            # not as complete.
            self._require_complete(node)
            outcome = Outcome.COMPLETE
        except Ending as ending:
            outcome = ending.outcome
            raise
        finally:
            # Whatever ended it, also a closed generator: an open record would take the samples of what
            # follows.
            self._sampling.repeatable = False
            self._close(outcome)
        self._progress.records_done += 1

    def _repeated(self, nodes: Sequence[Node], index: int, retries: int) -> Waiting:
        """Carry out a record that is repeated, with the set-up before it, if samples are lost inside.

        The return of a device that the run has waited for uses none of the `retries`.
        """
        # `before`: the commands with which the record began, as its own steps are to find them again.
        node, before, returns = nodes[index], dict(self._bench.commanded), 0
        while True:
            # `_again` is read by `_unwind` and `_require_complete` deep inside: whether lost samples end the
            # run there.
            self._again, self._repeating = retries > 0, True
            try:
                yield from self.visit(node)
                return
            except SamplesLost as lost:
                back = isinstance(lost, DeviceBack)
                # No attempt is left: the ending goes on to the groups around the record.
                if not (self._again or back):
                    raise
                self._bench.event("note", f"{node.label} is measured again: {lost.reason}")
            finally:
                self._again = self._repeating = False
            # The two are counted apart: a contact that fails every few minutes must not use up the
            # procedure's `retries`, nor go on for ever.
            returns, retries = returns + back, retries - (not back)
            if returns > _MOST_RETURNS:
                ending = _lost_too_often(node)
                self._secure(ending)
                raise ending
            if back:  # also what was set before the group; without a wait the set-up is thought to do
                self.baseline = before
                with suppress(Restart):  # after another pause, which has restored the same
                    yield CHECKPOINT  # of a person who has asked for a pause meanwhile
                    yield from self._bench.restored(before)
            # The outputs went off with the loss: temperature, pressure and position are not what the record
            # needs until the steps that set them have been done again.
            for step in setup_before(nodes, index):
                yield from self.visit(step)

    def _open(self, node: RecordNode, path: str) -> None:
        bench = self._bench
        try:
            began = bench.record_began = bench.now
            # The order matters: the record exists before the rate changes, so that its first fast sample
            # belongs to it.
            bench.writer.open_record(began, node.name, node.sweep, path, node.rate)
            bench.history.begin_record(began)
            self._sampling.completeness = Completeness(bench.rig, node.channels, node.rate, began)
            bench.start(node.rate)
        except Exception as error:  # noqa: BLE001 - as for a step
            ending = ending_for(error, bench)
            self._secure(ending)
            raise ending from None

    def _require_complete(self, node: RecordNode) -> None:
        """Refuse a record that lacks too much to be what the procedure asked for."""
        counted = self._sampling.completeness
        # Devices with `lost: continue` owe nothing: the record was allowed to go on without them.
        lacks = counted.lacks(self._bench.now, self._spare) if counted is not None else []
        too_much = [lack for lack in lacks if lack.exceeds(node.most_missing)]
        if not too_much:
            return
        missing = ", ".join(map(str, too_much))
        most = f"{100.0 * node.most_missing:.3g} %"
        reason = f"{node.label} lacks {missing}, more than {most}"
        ending: Ending = SamplesLost(reason, where=node.where)
        # `SamplesLost` would be secured without an end of the run, and `_unwind` would take it for a
        # repetition.
        if not self._again:  # nothing is measured again: the run ends with this
            ending = StepFailed(reason, outcome=SamplesLost.outcome, where=node.where)
        self._secure(ending)
        raise ending

    def _close(self, outcome: Outcome) -> None:
        bench = self._bench
        if not bench.recording:
            return
        bench.history.end_record()
        # Here all devices count: what is missing is stored with the record, whether or not it was tolerated.
        counted, self._sampling.completeness = self._sampling.completeness, None
        lacks = counted.lacks(bench.now) if counted is not None else []
        if lacks:
            bench.event("note", f"missing in the record: {', '.join(map(str, lacks))}")
        try:
            bench.writer.close_record(bench.now, outcome.value, worst(lacks))
            # Back to the rate for watching, which only a bench within reach can be told.
            if bench.reachable:
                bench.start(bench.watching_rate)
        except Exception as error:  # noqa: BLE001 - as for a step
            ending = ending_for(error, bench)
            self._secure(ending)
            raise ending from None

    # --- paths -------------------------------------------------------------------------------------------

    def _path(self, path: str) -> str:
        """The path of a node with the rounds of the loops around it."""
        for loop, number in reversed(self._rounds):
            path = iteration_path(loop, number, path)
        return path

    def _done(self, path: str) -> bool:
        return self._path(path) in self._completed

    def _fail(self, node: Node, reason: str) -> Ending:
        ending = StepFailed(reason, where=node.where)
        self._secure(ending)
        return ending


def _lost_too_often(node: Node) -> Lost:
    return Lost(f"{node.label}: a device was lost again and again", where=node.where)


def _record_in(node: Node) -> RecordNode | None:
    """A record, which its cleanup surrounds as a group."""
    if isinstance(node, Group) and len(node.children) == 1:
        return _record_in(node.children[0])
    return node if isinstance(node, RecordNode) else None
