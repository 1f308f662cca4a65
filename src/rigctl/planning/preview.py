"""The preview of a plan: durations, records, sweep sizes, limits and warnings as a tree.

In: a plan, bound to its rig. Out: a `Preview` with a node for every node of the plan. Nothing is moved and
nothing is simulated: each step forecasts its own duration and the state it leaves, by the simple balances of
`rigctl.plan.forecast`, so that a preview of a long campaign takes no time. Each duration carries the basis
on which it rests, and a sum carries that of its least certain part.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from rigctl.argument_types import checks_argument_types
from rigctl.errors import Location
from rigctl.notebook import one_line
from rigctl.plan import Branch, Group, GroupKind, Leaf, Loop, Node, Plan, RecordNode, Visitor, all_nodes
from rigctl.plan.action import Action
from rigctl.plan.forecast import Basis, State
from rigctl.planning.bench import ForecastBench, bench_of, initial_state
from rigctl.planning.board_loops import not_on_board
from rigctl.planning.limits import LimitUse, limits_used
from rigctl.planning.rates import controlled, too_fast
from rigctl.rig import Rig
from rigctl.wording import number_of


@dataclass(frozen=True, slots=True)
class PreviewNode:
    """A node of the plan with its forecast; a loop counts all its rounds."""

    path: str
    label: str
    kind: str  #: "step", "record", "loop", "branch", or the kind of the group
    where: Location
    seconds: float
    basis: Basis
    records: int
    samples: int
    children: tuple[PreviewNode, ...] = ()
    bindings: Mapping[str, str] = field(default_factory=dict)
    times: int | None = 1  #: rounds of a loop; None if a condition decides
    counted: bool = True  #: False for steps that are carried out only if something goes wrong
    warning: str | None = None

    def walk(self, *, counted: bool = False) -> Iterator[PreviewNode]:
        """This node and all below it; with `counted`, without those that run only if something goes wrong."""
        stack = [self]
        while stack:
            node = stack.pop()
            if counted and not node.counted:
                continue
            yield node
            stack.extend(reversed(node.children))


@dataclass(frozen=True, slots=True)
class SweepSize:
    """One `for` of the plan."""

    path: str
    variables: tuple[str, ...]
    points: int


@dataclass(frozen=True, slots=True)
class Preview:
    """The forecast of a plan; the first round of a loop represents all of them."""

    plan: Plan
    roots: tuple[PreviewNode, ...]  #: the procedure, then its cleanup blocks
    limits: tuple[LimitUse, ...]
    start: State

    def __repr__(self) -> str:
        """The forecast on one line."""
        return one_line(self, self.summary())

    def summary(self) -> str:
        """One line: how many records, and how long it is expected to take."""
        return f"{self.plan.name}: {number_of(self.records, 'record')}, {self.seconds:.3g} s"

    @property
    def start_readings(self) -> Mapping[str, float]:
        """The expected readings at the start, SI, on which the estimate is based."""
        roles, start = self.plan.rig.roles, self.start
        readings: dict[str, float] = {}
        if roles.heat is not None and start.temperature is not None:
            readings[roles.heat.channel] = start.temperature
        if roles.set_pressure is not None:
            readings[roles.set_pressure.channel] = start.pressure
        if roles.extend is not None and roles.extend.position is not None:
            readings[roles.extend.position] = start.position
        return readings

    @property
    def seconds(self) -> float:
        """Expected duration."""
        return sum(root.seconds for root in self.roots if root.counted)

    @property
    def basis(self) -> Basis:
        """The basis of the least certain part of the duration."""
        return max(root.basis for root in self.roots if root.counted)

    @property
    def records(self) -> int:
        """Number of records of the run."""
        return sum(root.records for root in self.roots if root.counted)

    @property
    def samples(self) -> int:
        """Approximately how many samples the records will hold."""
        return sum(root.samples for root in self.roots if root.counted)

    @property
    def unattended_for(self) -> float | None:
        """s for which it waits for an answer with outputs on and nobody there; None if it asks nothing."""
        leaves = (node for node in all_nodes(self.plan) if isinstance(node, Leaf))
        asked = (one for leaf in leaves for one in leaf.action.questions(self.plan.rig) if not one.notice)
        return self.plan.rig.unattended_for if any(asked) else None

    @property
    def open_ended(self) -> bool:
        """True if a condition decides how often something is done."""
        return any(node.times is None for node in self.walk(counted=True))

    @property
    def warnings(self) -> tuple[tuple[Location, str], ...]:
        """Warnings with their locations, each once."""
        warnings = [(node.where, f"{node.label}: {node.warning}") for node in self.walk() if node.warning]
        return tuple(dict.fromkeys(warnings))

    @property
    def sweeps(self) -> tuple[SweepSize, ...]:
        """Every `for` of the plan, in order."""
        return tuple(_sweep_size(node) for node in self.walk() if node.kind == GroupKind.FOR.value)

    def durations(self) -> dict[str, float]:
        """Expected duration of each single step, s, by its path; a step in a loop once."""
        return {node.path: node.seconds for node in self.walk(counted=True) if node.kind == "step"}

    def walk(self, *, counted: bool = False) -> Iterator[PreviewNode]:
        """Every node in order of execution."""
        for root in self.roots:
            yield from root.walk(counted=counted)


def _sweep_size(node: PreviewNode) -> SweepSize:
    points = [child for child in node.children if child.kind == GroupKind.ITERATION.value]
    return SweepSize(node.path, tuple(points[0].bindings) if points else (), len(points))


@checks_argument_types
def preview(plan: Plan) -> Preview:
    """Forecast a plan step by step, from the initial state in the rig file.

    Heating follows from the heat balance of the tank, moves from the flow through the throttle, conditions
    count with their timeouts, and for a person the times in `rigctl.plan.forecast` are assumed.
    """
    bench = bench_of(plan.rig)
    start = initial_state(bench)
    walker = _Walker(bench, start)
    # One state (temperature, pressure, position) is carried along in the order of execution, since each
    # step's duration depends on where the one before left the bench. Blocks that run only after a failure are
    # forecast from there too, but leave no trace in state, totals or limits.
    roots = [walker.visit(plan.root)]
    roots += [walker.visit_uncounted(block) for block in (plan.on_failure, plan.on_abort) if block]
    if plan.finally_ is not None:
        roots.append(walker.visit(plan.finally_))
    known = Preview(plan, tuple(roots), (), start)
    return replace(known, limits=limits_used(plan.rig, walker.reached, known.start_readings))


class _Walker(Visitor[PreviewNode]):
    """Carries the expected state from step to step."""

    def __init__(self, bench: ForecastBench, state: State) -> None:
        self.bench = bench
        self.state = state
        self.reached: dict[str, tuple[float, float]] = {}
        self._in_loop = False

    def visit_uncounted(self, block: Group) -> PreviewNode:
        """A block that runs only if something goes wrong: the state is unchanged."""
        state, reached = self.state, dict(self.reached)
        node = self.group(block, counted=False)
        self.state, self.reached = state, reached
        return node

    def leaf(self, node: Leaf) -> PreviewNode:
        """A step with its forecast; updates the state."""
        expected = node.action.forecast(self.state, self.bench)
        self.state = expected.state
        for channel, (low, high) in expected.reaches.items():
            known = self.reached.get(channel, (low, high))
            self.reached[channel] = (min(known[0], low), max(known[1], high))
        return PreviewNode(
            node.path,
            node.label,
            "step",
            node.where,
            expected.seconds,
            expected.basis,
            records=0,
            samples=0,
            warning=expected.warning
            or not_on_board(self.bench.rig, node.action)
            or too_fast(self.bench.rig, node.action.needed_rate, loop_on=controlled(node.action))
            or too_fine(self.bench.rig, node.action),
        )

    def group(self, node: Group, *, counted: bool = True) -> PreviewNode:
        """The forecast of a group: the sum over its nodes and the cleanup that always runs."""
        below = [self.visit(child) for child in node.children]
        below += [self.visit_uncounted(block) for block in (node.on_failure, node.on_abort) if block]
        if node.finally_ is not None:
            below.append(self.visit(node.finally_))
        return _sum(node, node.kind.value, below, bindings=node.bindings, counted=counted)

    def record(self, node: RecordNode) -> PreviewNode:
        """The forecast of a record: the duration of its body, and its number of samples."""
        body = self.group(node.body)
        samples = round(body.seconds * node.rate)
        warning = too_fast(self.bench.rig, node.rate)
        return _sum(node, "record", [*body.children], records=1, samples=samples, warning=warning)

    def loop(self, node: Loop) -> PreviewNode:
        """The forecast of a loop: that of its first round times the number of rounds."""
        # The second round is not the first: it begins where the first ended (oil already warm, rod already
        # out). From the second on, rounds are taken to be alike.
        first = self.group(node.body)
        times = node.count
        if times == 0:
            return _scaled(node, first, 0, 0.0, times)
        rounds = 1 if times is None else times
        later = first
        # a later round is forecast only once; nested loops would double the work at each level
        if rounds > 1 and not self._in_loop:
            self._in_loop = True
            later = self.group(node.body)
            self._in_loop = False
        return _scaled(node, first, rounds, first.seconds + (rounds - 1) * later.seconds, times)

    def branch(self, node: Branch) -> PreviewNode:
        """Preview of both branches; the duration is that of the longer one."""
        before = self.state
        then = self.group(node.then)
        if node.otherwise is None:
            return _sum(node, "branch", [then])
        after_then, self.state = self.state, before
        otherwise = self.group(node.otherwise)
        if then.seconds >= otherwise.seconds:
            self.state = after_then
        longer = max(then, otherwise, key=lambda side: side.seconds)
        return _sum(node, "branch", [then, otherwise], counting=[longer])


def too_fine(rig: Rig, action: Action) -> str | None:
    """Why the readings of a step's channel cannot settle within its tolerance; None if they can."""
    wanted = action.settles_at()
    if wanted is None or wanted.within is None:
        return None
    why = rig.channels[wanted.channel].too_fine(wanted.within)
    return f"{wanted.channel}: {why}" if why else None


def _sum(
    node: Node,
    kind: str,
    below: list[PreviewNode],
    *,
    counting: list[PreviewNode] | None = None,
    bindings: Mapping[str, str] | None = None,
    counted: bool = True,
    records: int = 0,
    samples: int | None = None,
    warning: str | None = None,
) -> PreviewNode:
    parts = [part for part in (below if counting is None else counting) if part.counted]
    return PreviewNode(
        node.path,
        node.label,
        kind,
        node.where,
        seconds=sum(part.seconds for part in parts),
        basis=max((part.basis for part in parts), default=Basis.TIMED),
        records=records + sum(part.records for part in parts),
        samples=sum(part.samples for part in parts) if samples is None else samples,
        children=tuple(below),
        bindings=bindings or {},
        counted=counted,
        warning=warning,
    )


def _scaled(node: Loop, first: PreviewNode, rounds: int, seconds: float, times: int | None) -> PreviewNode:
    return PreviewNode(
        node.path,
        node.label,
        "loop",
        node.where,
        seconds=seconds,
        basis=first.basis if times is not None else Basis.AT_MOST,
        records=first.records * rounds,
        samples=first.samples * rounds,
        children=first.children,
        times=times,
    )
