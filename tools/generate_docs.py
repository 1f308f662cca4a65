"""Write the generated pages of the documentation; a test fails if one is out of date.

python tools/generate_docs.py            write them
python tools/generate_docs.py --check    say which would change
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"


def pages() -> Iterator[tuple[Path, str]]:
    """Return every generated page with its text."""
    sys.path[:0] = [str(ROOT), str(ROOT / "tools")]  # benchmarks and tools are no installed packages
    from api_page import api_page
    from benchmarks.engine.page import with_figures
    from benchmarks.scoreboard.page import page as scoreboard_page
    from benchmarks.validation.page import with_rates
    from reference_pages.effects import effects_page
    from reference_pages.generic_effects import generic_page
    from reference_pages.rig_file import rig_page
    from reference_pages.run_states import run_states_page
    from reference_pages.steps import steps_page
    from reference_pages.units import units_page

    from rigctl.physics.families import FAMILIES

    yield DOCS / "reference" / "commands.md", commands_page()
    yield DOCS / "reference" / "dataset.md", dataset_page()
    yield DOCS / "reference" / "python-names.md", api_page()
    yield DOCS / "reference" / "procedure-steps.md", steps_page()
    yield DOCS / "reference" / "rig-file.md", rig_page()
    yield DOCS / "reference" / "units.md", units_page()
    yield DOCS / "reference" / "run-states.md", run_states_page()
    engine = DOCS / "explanation" / "engine.md"
    yield engine, with_figures(engine)
    validation = DOCS / "explanation" / "diagnosis-validation.md"
    yield validation, with_rates(validation)
    yield DOCS / "explanation" / "public-benchmarks.md", scoreboard_page()
    yield DOCS / "reference" / "effects" / "generic.md", generic_page()
    for family in FAMILIES.values():
        yield DOCS / "reference" / "effects" / f"{family.name}.md", effects_page(family)


def commands_page() -> str:
    """Return a page with the help of every command, as in the terminal."""
    from rigctl.cli.catalogue import ENTRIES
    from rigctl.cli.main import load_command

    parts = ["# Commands\n\n*Generated: `make docs`.*\n\nEvery command takes `--help`.\n"]
    panel = ""
    for entry in ENTRIES:
        if entry.panel != panel:
            panel = entry.panel
            parts.append(f"## {panel}\n")
        command = load_command(entry.name)
        parts.append(f"### rigctl {entry.name}\n\n{entry.summary}\n")
        nested = getattr(command, "commands", None)
        for name, one in (nested or {entry.name: command}).items():
            title = f"rigctl {entry.name} {name}" if nested else f"rigctl {entry.name}"
            parts.append(f"```text\n{_help_of(one, title)}\n```\n")
    return "\n".join(parts)


def dataset_page() -> str:
    """Return the page of the dataset with the fields of ``run.json`` and the columns that they fill."""
    from rigctl.dataset.run_fields import FIELDS

    fields, columns = "| field | meaning |\n|---|---|\n", "| column | type | in `run.json` |\n|---|---|---|\n"
    for name, field in FIELDS.items():
        fields += f"| `{name}` | {field.meaning} |\n"
        for column in field.columns:
            place = f"`{name}`" if column.key is None else f"`{column.key}` of `{name}`"
            columns += f"| `{column.name}` | {column.sql} | {place} |\n"
    text = _read(DOCS / "reference" / "dataset.md")
    for title, table in (("run.json", fields), ("columns of runs", columns)):
        begin, end = f"<!-- {title}: make docs -->\n", f"<!-- end of {title} -->\n"
        before, rest = text.split(begin)
        text = before + begin + table + end + rest.split(end)[1]
    return text


def _help_of(command: object, title: str) -> str:
    """Return plain help text at a fixed width, without colours and boxes."""
    command.rich_markup_mode = None  # type: ignore[attr-defined]
    with command.make_context(title, [], resilient_parsing=True, terminal_width=100) as context:  # type: ignore[attr-defined]
        text = command.get_help(context)  # type: ignore[attr-defined]
    return re.sub(r"[ \t]+\n", "\n", text).strip()


def main() -> int:
    """Write or check the pages; the exit status is 1 if a checked page is out of date."""
    stale = [(path, text) for path, text in pages() if _read(path) != text]
    for path, text in stale:
        print(("out of date: " if "--check" in sys.argv else "written: ") + str(path))
        if "--check" not in sys.argv:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8", newline="\n")
    return int(bool(stale) and "--check" in sys.argv)


def _read(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.exists() else ""


if __name__ == "__main__":
    sys.exit(main())
