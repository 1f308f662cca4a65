"""A preview in a terminal: a tree in which long sweeps show only their first point.

In: a `Preview`, and warnings on the rig. Out: lines and trees for `rich`, which is imported when something
is drawn. What is uncertain is marked in words ("about", "at most") by the basis of the estimate.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from rigctl.plan import GroupKind
from rigctl.plan.forecast import Basis
from rigctl.planning.limits import LimitUse
from rigctl.planning.preview import Preview, PreviewNode
from rigctl.printable import printable
from rigctl.units import show
from rigctl.wording import number_of

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.text import Text
    from rich.tree import Tree

    from rigctl.rig import Rig

_MARKS = {Basis.TIMED: "", Basis.ESTIMATED: "about ", Basis.GUESSED: "about ", Basis.AT_MOST: "at most "}
_MEANINGS = {
    Basis.TIMED: "every step is timed",
    Basis.ESTIMATED: "heating from the heat balance, moves from the flow",
    Basis.GUESSED: "people are assumed to take 10 to 20 s",
    Basis.AT_MOST: "steps that end on a condition count with their timeouts",
}


def outline(
    preview: Preview, warnings: Sequence[str] = (), *, everything: bool = False
) -> Iterator[RenderableType]:
    """The output for `rich`: a heading, the tree, the limits that matter, and what will probably not work.

    Parameters
    ----------
    warnings: additional ones, on the rig.
    everything: show every point of every sweep.
    """
    plan = preview.plan
    yield _line(plan.name, "bold", f" on {plan.rig.name}")
    records = number_of(preview.records, "record")
    more = " or more" if preview.open_ended else ""
    yield _line(
        f"{records}{more}, {preview.samples} samples, {_MARKS[preview.basis]}{clock_time(preview.seconds)}",
        "",
        f" ({_MEANINGS[preview.basis]})",
    )
    if preview.start_readings:
        start = ", ".join(_reading(plan.rig, *reading) for reading in preview.start_readings.items())
        yield _line("expected to start at ", "", f"{start} (simulation.initial of the rig file)")
    if preview.unattended_for is not None:
        bound = clock_time(preview.unattended_for)
        yield _line("asks the operator", "", f"; with outputs on and nobody there it ends after {bound}")
    if plan.arguments:
        yield _line("with ", "", ", ".join(f"{name} = {value}" for name, value in plan.arguments.items()))
    for root in preview.roots:
        yield _tree(root, everything)
    yield from _limits(preview)
    for where, message in preview.warnings:
        yield _line("warning: ", "yellow", f"{where}: {message}")
    for message in warnings:
        yield _line("warning: ", "yellow", message)


def _reading(rig: Rig, name: str, si: float) -> str:
    channel = rig.channels[name]
    return f"{name} {show(si, channel.unit, difference=channel.difference)}"


def clock_time(seconds: float) -> str:
    """A duration in everyday form: ``3.75 s``, ``8 min 41 s``, ``25 min``, ``1 h 25 min``."""
    if seconds < 59.95:
        return f"{seconds:.3g} s"
    total = round(seconds)
    if total < 600:
        minutes, rest = divmod(total, 60)
        return f"{minutes} min {rest} s" if rest else f"{minutes} min"
    if total < 3570:
        return f"{round(seconds / 60.0)} min"
    hours, minutes = divmod(round(seconds / 60.0), 60)
    return f"{hours} h {minutes} min" if minutes else f"{hours} h"


def _line(start: str, style: str, rest: str = "") -> Text:
    from rich.text import Text

    return Text.assemble((printable(start), style), (printable(rest), "dim" if not style else ""))


def _tree(node: PreviewNode, everything: bool) -> Tree:
    from rich.tree import Tree

    tree = Tree(_entry(node))
    _grow(tree, node, everything)
    return tree


def _grow(tree: Tree, node: PreviewNode, everything: bool) -> None:
    # Only the first point of a sweep is drawn, and the others become one line with their total; iterations
    # are told from the sweep's cleanup by their kind.
    shown = node.children
    hidden: tuple[PreviewNode, ...] = ()
    if node.kind == GroupKind.FOR.value and not everything:
        points = [child for child in node.children if child.kind == GroupKind.ITERATION.value]
        hidden = tuple(points[1:])
        shown = tuple(child for child in node.children if child not in hidden)
    for child in shown:
        _grow(tree.add(_entry(child)), child, everything)
        if hidden and child.kind == GroupKind.ITERATION.value:
            tree.add(_summary(hidden))


def _entry(node: PreviewNode) -> Text:
    from rich.text import Text

    if not node.counted:
        return Text(f"{printable(node.label)} (only then)", "dim")
    style = "bold" if node.kind == "record" else ""
    entry = Text(printable(node.label), style)
    as_written = node.kind == "step" and node.basis is Basis.TIMED
    if node.seconds > 0.0 and not as_written:
        entry.append(f"  {_MARKS[node.basis]}{clock_time(node.seconds)}", "dim")
    if node.records > 1:
        entry.append(f", {node.records} records", "dim")
    if node.times is None:
        entry.append(", one round shown", "dim")
    return entry


def _summary(points: Sequence[PreviewNode]) -> Text:
    from rich.text import Text

    seconds = sum(point.seconds for point in points)
    records = sum(point.records for point in points)
    labels = [point.label for point in points]
    named = ", ".join(labels) if len(labels) <= 3 else f"{labels[0]} … {labels[-1]}"
    text = f"{len(points)} more: {named}  {_MARKS[max(p.basis for p in points)]}{clock_time(seconds)}"
    return Text(printable(f"{text}, {number_of(records, 'record')}" if records else text), "dim")


def _limits(preview: Preview) -> Iterator[Text]:
    for use in preview.limits:
        if use.state in ("touched", "approached") and use.closest is not None:
            style = "red" if use.state == "touched" else "yellow"
            yield _line(f"limit {use.name} {use.state}: ", style, _comparison(preview, use))


def _comparison(preview: Preview, use: LimitUse) -> str:
    channel = preview.plan.rig.channels[use.channel]

    def shown(value: float) -> str:
        return show(value, channel.unit, difference=channel.difference)

    side = "up to" if use.bound == "above" else "down to"
    expected = f"{use.channel} is expected {side} {shown(use.closest or 0.0)}"
    return f"{expected}, {use.action} {use.bound} {shown(use.threshold)}"
