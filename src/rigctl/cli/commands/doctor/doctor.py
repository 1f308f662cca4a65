"""`rigctl doctor`: what is installed, what is missing, and how to get it.

In: this installation, this computer and the project; with `--port` or `--rig` also devices. Out: a line
for each `Finding` with its remedy, and an exit code for scripts: 1 if anything is broken. What is only
optional, such as an extra that nobody has asked for, breaks nothing.

Checks go from cheap to slow. Extras and drivers are found without being imported, and ports are listed
without being opened. The part about the bench is in `bench`, the measurement of clocks in `align`.
"""

from __future__ import annotations

import platform
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rigctl.cli.commands.doctor.finding import Finding
from rigctl.cli.echo import print_json
from rigctl.cli.options.as_json import Json
from rigctl.cli.options.driver import AllowDriverOption
from rigctl.errors import RigctlError

if TYPE_CHECKING:
    from rigctl.backends.transport.serial_ports import PortInfo, PortsUnlisted


#: import name, extra, what it is for
_EXTRAS = (
    ("nptdms", "tdms", "reads and writes LabVIEW's TDMS files"),
    ("asammdf", "mdf", "reads and writes MDF4 files"),
    ("openpyxl", "xlsx", "reads and writes spreadsheets"),
    ("pyvisa", "visa", "communicates with instruments through VISA: network, USB, GPIB"),
    ("asyncua", "opcua", "reads and writes the nodes of OPC UA servers"),
    ("fsspec", "storage", 'keeps runs in object storage: runs = "s3://bucket/runs"'),
    ("fmpy", "fmu", "runs FMUs beside a model"),
    ("distributed", "cluster", "sends independent tasks to a Dask cluster: --cluster"),
    ("pymodbus", "modbus", "communicates with devices that have Modbus registers"),
)


def examine(ports: Sequence[PortInfo] | PortsUnlisted = ()) -> Iterator[Finding]:
    """Check everything that rigctl depends on, cheapest first. Nothing is opened, nothing moves."""
    from rigctl.cli.commands.doctor.bench import emulator_finding, guard_findings, port_findings, rig_findings
    from rigctl.project import find_project

    yield _interpreter()
    yield from _packages()
    yield from _extras()
    yield _engine_cache()
    yield _project()
    yield from _drivers()
    yield from _plugins()
    yield emulator_finding()
    yield from rig_findings(find_project().root / "rigs")
    yield from port_findings(ports)
    yield from guard_findings()


def _interpreter() -> Finding:
    return Finding("Python", "ok", f"{platform.python_version()} on {platform.system()} {platform.machine()}")


def _packages() -> Iterator[Finding]:
    """Every package that rigctl requires, as its own metadata lists them."""
    for requirement in requires("rigctl") or ():
        if "extra ==" in requirement:
            continue
        name = requirement.partition(">")[0].partition("<")[0].strip()
        try:
            yield Finding(name, "ok", version(name))
        except PackageNotFoundError:
            yield Finding(name, "broken", "not installed", f"pip install '{requirement}'")


def _extras() -> Iterator[Finding]:
    for module, extra, purpose in _EXTRAS:
        if find_spec(module):
            yield Finding(f"{extra} (extra)", "ok", purpose)
        else:
            yield Finding(f"{extra} (extra)", "optional", purpose, f"pip install 'rigctl[{extra}]'")


def _engine_cache() -> Finding:
    """The folder that keeps compiled models; without it every start compiles again."""
    from rigctl.engine.cache import cache_root
    from rigctl.files.private import private_folder

    folder = cache_root()
    try:
        private_folder(folder)
    except OSError as problem:
        wanted = "make it your own, writable by nobody else"
        return Finding("compiled models", "broken", f"not used: {problem}", wanted)
    if _writable(folder):
        return Finding("compiled models", "ok", folder.as_posix())
    return Finding("compiled models", "broken", *_unwritable(folder))


def _project() -> Finding:
    from rigctl.project import find_project

    project = find_project()
    if not _writable(project.runs):
        return Finding("runs folder", "broken", *_unwritable(project.runs))
    return Finding("runs folder", "ok", project.runs.as_posix())


def _plugins() -> Iterator[Finding]:
    """What other installed packages add; one that cannot be loaded breaks nothing but itself."""
    from rigctl.plugins import GROUPS, examine_plugins

    for one in examine_plugins():
        what = f"{GROUPS[one.group]} of {one.package}"
        if one.trouble:
            yield Finding(f"{one.name} (plug-in)", "broken", f"{what}: {one.trouble}", "update or remove it")
        else:
            yield Finding(f"{one.name} (plug-in)", "ok", what)


def _drivers() -> Iterator[Finding]:
    """The packages that drivers of devices may be imported from; none is imported here."""
    from rigctl.backends.python.permission import allowed, distribution
    from rigctl.project import find_project

    known = allowed()
    for package in sorted({*find_project().drivers} - known):
        yield Finding(
            f"{package} (driver)",
            "optional",
            "listed in rigctl.toml, not allowed",
            f"--allow-driver {package}",
        )
    for package in sorted(known):
        if find_spec(package) is None:
            yield Finding(
                f"{package} (driver)", "broken", "allowed, but not installed", f"pip install {package}"
            )
        else:
            yield Finding(
                f"{package} (driver)", "ok", f"may be imported for drivers: {distribution(package)}"
            )


def _unwritable(folder: Path) -> tuple[str, str]:
    return f"cannot write {folder.as_posix()}", "make the folder writable"


def _writable(folder: Path) -> bool:
    """Whether a file can be made in `folder`, or in the nearest folder above that exists."""
    import tempfile

    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def doctor(
    port: Annotated[
        list[str] | None,
        typer.Option(
            help="Port to open and query for its device; repeatable. A board may restart when it is opened. "
            "NAME=ADDRESS for one of several devices of --rig."
        ),
    ] = None,
    baud: Annotated[int, typer.Option(min=300, help="Baud rate for the ports that are opened.")] = 115200,
    rig: Annotated[
        Path | None,
        typer.Option(help="Rig file whose devices are read, all channels, at their ports or at --port."),
    ] = None,
    allow_driver: AllowDriverOption = None,
    *,
    align: Annotated[
        bool,
        typer.Option(
            "--align",
            help="Instead, measure how far the clocks of several devices are off, by the output that 'align' "
            "in the rig file names. This moves it; all outputs are safe afterwards.",
        ),
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="With --align: move the output unasked.")] = False,
    write: Annotated[
        bool, typer.Option("--write", help="With --align: write the offsets to the rig file unasked.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Report what is installed, what is missing and how to get it, and which serial ports can be used.

    No port is opened unless --port names it. The device is then sent *IDN? or VER, and its line is tested:
    how many of 50 answers arrive complete, and how fast. Do not name the port of a device that these queries
    may disturb.

    Examples:

      rigctl doctor

      rigctl doctor --port /dev/ttyACM0

      rigctl doctor --rig rigs/oil-circuit-modbus.yaml --port 192.168.0.20:502

      rigctl doctor --rig rigs/my-bench.yaml --align
    """
    if align:
        from rigctl.cli.commands.doctor.align import align_devices

        align_devices(rig, port, yes=yes, write=write, as_json=as_json)
        return
    if yes or write:
        raise RigctlError("--yes and --write belong to --align", expected="--align")
    _examine(port, baud, rig, as_json=as_json)


def _examine(port: Sequence[str] | None, baud: int, rig: Path | None, *, as_json: bool) -> None:
    """Report the findings, and end with their exit code."""
    from rigctl.backends.transport.serial_ports import PortsUnlisted, list_ports
    from rigctl.cli.commands.doctor.bench import ask_port, ask_rig, ports_document

    if rig is not None:  # a file that cannot be read is a wrong call, not a fault of the bench
        from rigctl.project import find_file
        from rigctl.rig import load_rig

        rig = find_file(rig)
        load_rig(rig)
    ports: Sequence[PortInfo] | PortsUnlisted
    try:
        ports = list_ports()
    except PortsUnlisted as error:
        ports = error
    findings = list(examine(ports))
    if rig is None:
        replies = [ask_port(url, baud) for url in port or ()]
        findings += [finding for finding, _ in replies]
        answers = [answer for _, answer in replies]
    else:
        found, answers = ask_rig(rig, port or ())
        findings += found
    broken = any(finding.state == "broken" for finding in findings)
    if as_json:
        document = {
            "healthy": not broken,
            "findings": [asdict(finding) for finding in findings],
            "ports": ports_document(ports),
            "asked": answers,
        }
        print_json(document, indent=1)
    else:
        _show(findings)
    raise typer.Exit(1 if broken else 0)


def _show(findings: list[Finding]) -> None:
    """Show a line for each finding, and below it the remedy, unwrapped so that it can be copied."""
    from rich.markup import escape

    from rigctl.cli.tables import console

    out = console(soft_wrap=True)
    marks = {"ok": "[green]✓[/]", "optional": "[dim]–[/]", "broken": "[red]✗[/]"}
    width = max(len(finding.subject) for finding in findings)
    for finding in findings:
        out.print(f"{marks[finding.state]} {escape(finding.subject.ljust(width))}  {escape(finding.detail)}")
        if finding.fix:
            out.print(f"{' ' * (width + 4)}[bold]{escape(finding.fix)}[/]")
