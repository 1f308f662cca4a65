"""`rigctl init`: a working project folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rigctl.cli.echo import echo, print_json
from rigctl.cli.options.as_json import Json
from rigctl.errors import Location, RigctlError

_MARKER = """\
# Marks the root of a rigctl project: relative paths in its files resolve from this folder.

# where runs are kept
runs = "runs"

# the rig of 'rigctl off', 'jog' and 'monitor' without --rig
rig = "rigs/hl32-bench.yaml"
"""

_README = """\
# A rigctl project

| folder | holds |
|---|---|
| `rigs/` | descriptions of benches: channels, actuators, calibrations, limits, safe state |
| `procedures/` | what the bench is to do, step by step |
| `models/` | physical models that the measurements are compared with |
| `data/` | example measurements, described in its README |
| `runs/` | what was measured, one folder for each run; nothing is ever overwritten |

    rigctl check procedures/quick-check.yaml       # the plan: steps, records, duration, limits
    rigctl simulate procedures/quick-check.yaml    # on the simulated bench, as fast as it computes
    rigctl report latest                           # a page about the newest run
    rigctl run procedures/quick-check.yaml         # on the backend named in the rig file
    rigctl import data/unknown-bench.csv --rig rigs/hl32-bench.yaml    # data measured elsewhere
"""

#: shipped folders, and which of their files a project gets
_SHIPPED = {"rigs": "*.yaml", "procedures": "*.yaml", "models": "*.yaml", "data": "*"}
#: in a minimal one: a commented example
_MINIMAL = {"rigs": "line-device.yaml"}

_MINIMAL_MARKER = """\
# Marks the root of a rigctl project: relative paths in its files resolve from this folder.

# where runs are kept
runs = "runs"

# the rig of 'rigctl off', 'jog' and 'monitor' without --rig
# rig = "rigs/my_bench.yaml"
"""

_MINIMAL_README = """\
# A rigctl project

    rigctl family new my_bench --csv log.csv       # a family, rig and model file drafted from your data
    rigctl family new other --template motor       # or from a template, without data
    rigctl check rigs/line-device.yaml             # an example: a device that exchanges lines of text
    rigctl doctor --rig rigs/line-device.yaml --port PORT    # does it answer? then 'monitor', 'jog'
    rigctl check rigs/my_bench.yaml                # what the file describes, and any mistakes in it
    rigctl import log.csv --rig rigs/my_bench.yaml
    rigctl compare latest --model models/my_bench.yaml
"""


def create_project(directory: Path, *, minimal: bool = False) -> list[Path]:
    """Write the shipped rigs, procedures, models and data into `directory`; returns the files written.

    A `minimal` project has its ``rigctl.toml``, a README, and one commented rig file, of a device with lines.

    Raises
    ------
    RigctlError
        a file is already there (nothing is written then), or the folder cannot be written.
    """
    from rigctl.files.shipped import shipped
    from rigctl.files.write import write_text

    contents = {
        directory / "rigctl.toml": _MINIMAL_MARKER if minimal else _MARKER,
        directory / "README.md": _MINIMAL_README if minimal else _README,
    }
    for kind, files in (_MINIMAL if minimal else _SHIPPED).items():
        for source in sorted(shipped(kind).glob(files)):
            contents[directory / kind / source.name] = source.read_text(encoding="utf-8")
    taken = [path for path in contents if path.exists()]
    if taken:
        raise RigctlError(
            "the file is already there and nothing is overwritten",
            where=Location(taken[0]),
            hint="Choose an empty folder: 'rigctl init my-bench'",
        )
    try:
        for path, text in contents.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_text(path, text)
    except OSError as problem:
        raise RigctlError(
            "cannot write the project folder", value=str(problem.strerror), where=Location(directory)
        ) from problem
    return list(contents)


def mark_project(directory: Path) -> Path | None:
    """Make a folder a project by writing its ``rigctl.toml`` only; None if it is one already."""
    from rigctl.files.write import write_text

    marker = directory / "rigctl.toml"
    if marker.exists():
        return None
    try:
        write_text(marker, _MINIMAL_MARKER)
    except OSError as problem:
        raise RigctlError(
            "cannot write the project folder", value=str(problem.strerror), where=Location(directory)
        ) from problem
    return marker


def init(
    directory: Annotated[Path, typer.Argument(help="Folder to create; by default the current one.")] = Path(),
    *,
    minimal: Annotated[
        bool, typer.Option("--minimal", help="Leave out the shipped benches: for your own data and bench.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Create a working project folder: rigs, procedures, models, data, and a README with the first commands.

    Example: rigctl init my-bench

    Example: rigctl init --minimal
    """
    from rigctl.cli.next_command import one_below_another
    from rigctl.command_line import shell_word

    written = create_project(directory, minimal=minimal)
    if as_json:
        print_json({"project": directory.resolve(), "files": written}, indent=None)
        return
    for path in written:
        echo(f"  {path.as_posix()}")
    inside = "" if directory == Path() else f"cd {shell_word(directory.as_posix())}\n"
    command = "family new my_bench --csv FILE" if minimal else "check procedures/quick-check.yaml"
    echo(f"\nNext: {one_below_another(f'{inside}rigctl {command}')}")
