"""The pictures of README: ``python tools/readme_pictures.py`` writes ``docs/demo-strokes.svg`` and ``docs/demo.svg``.

Runs `rigctl demo`. The first picture is that at the top of its page; the second is its terminal, line by line:
an SVG whose lines appear one after the other where it is animated, and are all there where it is not.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

_DOCS = Path(__file__).parents[1] / "docs"
_WIDTH = 104
#: time from line to line, s
_EVERY = 0.35
_FONT = re.compile(r"@font-face \{.*?\}\s*", re.DOTALL)  # would be fetched from another server
_LINE = re.compile(r'clip-path="url\(#demo-line-(\d+)\)"')


def main() -> None:
    """Run the demo and write both pictures."""
    with tempfile.TemporaryDirectory() as place:
        command = [sys.executable, "-m", "rigctl", "demo", "my-demo"]
        environment = {**os.environ, "FORCE_COLOR": "1", "COLUMNS": str(_WIDTH)}
        # progress goes to stderr, and is overwritten on a terminal
        done = subprocess.run(
            command, cwd=place, env=environment, check=True, stdout=subprocess.PIPE, encoding="utf-8"
        )
        (_DOCS / "demo.svg").write_text(terminal(done.stdout), encoding="utf-8")
        write_strokes(Path(place) / "my-demo")


def terminal(printed: str) -> str:
    """What was printed, with its colours, as an SVG of a terminal."""
    from rich.console import Console
    from rich.text import Text

    text = printed.split("\nNext:", maxsplit=1)[0]  # the path of this environment
    with open(os.devnull, "w", encoding="utf-8") as nothing:
        console = Console(record=True, width=_WIDTH, force_terminal=True, file=nothing)
        console.print("[bold]$ rigctl demo my-demo[/]")
        console.print(Text.from_ansi(text))
        drawn = console.export_svg(title="rigctl", unique_id="demo")

    def timed(line: re.Match[str]) -> str:
        return f'{line[0]} style="animation: seen 0.01s {_EVERY * int(line[1]):.2f}s both"'

    appears = "<style>\n    @keyframes seen { from { opacity: 0 } to { opacity: 1 } }\n"
    return _LINE.sub(timed, _FONT.sub("", drawn)).replace("<style>\n", appears, 1)


def write_strokes(project: Path) -> None:
    """Measured strokes with the textbook's and the mended model's, as at the top of the demo's page."""
    from rigctl.analysis.comparison import compare
    from rigctl.dataset import list_runs, open_run
    from rigctl.model.history.save import load_version
    from rigctl.report.analysis.stroke_over_temperature import stroke_plot
    from rigctl.report.figure_files import write_figure

    run = next(one for one in list_runs(project / "runs") if "campaign" in one.id)
    path = project / "models" / "hl32-demo.yaml"
    models = [load_version(path, number) for number in (1, 2)]
    compared = compare([open_run(run.folder)], models, hold_out="oil == 60 degC").models
    names = ("textbook", "with what was missing")
    plot = stroke_plot([replace(one, name=name) for one, name in zip(compared, names, strict=True)])
    if plot is None:
        raise SystemExit("the demo has no strokes")
    caption = "Measured strokes fall as the oil warms (markers); the textbook says they rise (dotted)"
    write_figure(replace(plot, id="demo-strokes", caption=caption), _DOCS, "svg")


if __name__ == "__main__":
    main()
