"""The page `docs/reference/run-states.md`, written from the declared transition table."""

from __future__ import annotations

from rigctl.runner.states import EVENTS, STATES, transitions

_HEAD = """\
# The states of a run

*Generated* from `src/rigctl/runner/states.py` by `make docs`.

"""

_TAIL = """
`safe` can be reached from every state in which outputs may not be safe, including itself. The last three
states are final; outputs are safe in them.
"""


def run_states_page() -> str:
    """The page: a Mermaid diagram, the states, and what brings each transition about."""
    table = transitions()
    lines = ["```mermaid", "stateDiagram-v2", "    [*] --> idle"]
    lines += [f"    {source.value} --> {target.value}: {event}" for source, event, target in table]
    lines += [f"    {state.value} --> [*]" for state in STATES if state.ended]
    lines += ["```", "", "| state | meaning |", "|---|---|"]
    lines += [f"| {state.value} | {meaning} |" for state, meaning in STATES.items()]
    lines += ["", "| event | from | to | comes from |", "|---|---|---|---|"]
    for event, meaning in EVENTS.items():
        sources = ", ".join(source.value for source, name, _ in table if name == event)
        (target,) = {target.value for _, name, target in table if name == event}
        lines.append(f"| {event} | {sources} | {target} | {meaning} |")
    return _HEAD + "\n".join(lines) + "\n" + _TAIL
