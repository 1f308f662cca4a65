"""The output of `rigctl --help`: the commands in the order of a user's work, from the table alone."""

from __future__ import annotations

from rigctl.cli.catalogue import ENTRIES

_ABOUT = """\
Usage: rigctl COMMAND [ARGS]...

Run a test bench, record its behaviour, and find out what its model lacks.

First steps: 'rigctl init my-bench', then 'rigctl check' and 'rigctl simulate' one of its procedures, then
'rigctl report latest'. 'rigctl COMMAND --help' shows an example of each.
"""
_OPTIONS = """\
Options
  --version             Print the version.
  --install-completion  Install completion for the current shell.
  --show-completion     Show completion for the current shell.
  -h, --help            Show this message.
"""


def overview() -> str:
    """The text, 100 columns wide; nothing is imported for it."""
    width = max(len(entry.name) for entry in ENTRIES)
    lines = [_ABOUT]
    panel = ""
    for entry in ENTRIES:
        if entry.panel != panel:
            lines += ["", entry.panel] if panel else [entry.panel]
            panel = entry.panel
        lines.append(f"  {entry.name:<{width}}  {entry.summary}")
    return "\n".join([*lines, "", _OPTIONS])
