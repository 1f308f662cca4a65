"""The header of a run: the facts that are known when it begins.

In: a plan, its rig and the bench, or the options of an import. Out: a `RunHeader`, which is the first
line of the log and goes from there into `run.json`. It is written before the first sample, since a run
that is killed has nothing else: journal, log and header together suffice to recover it.

The texts of procedure and rig are stored verbatim, and not only their paths: files are edited later, and
a run is read and analysed with the rig that it was recorded with.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rigctl.rig import Layout, Rig


@dataclass(frozen=True)
class Source:
    """A file that a run was made from, stored with it verbatim.

    Parameters
    ----------
    name: the name given in the file, e.g. ``stroke campaign``.
    text: its content.
    sha256: of the content, hexadecimal; computed if omitted.
    path: the original path.
    """

    name: str
    text: str = ""
    sha256: str = ""
    path: str = ""

    def __post_init__(self) -> None:
        if not self.sha256:
            object.__setattr__(self, "sha256", hashlib.sha256(self.text.encode("utf-8")).hexdigest())


@dataclass(frozen=True)
class RunHeader:
    """The header of a run, which is the first line of its log.

    Parameters
    ----------
    id: the intended name of the run's folder, see `new_run_id`.
    procedure, rig: the files the run was made from.
    layout: the columns of a sample and their display units.
    backend: as reported by the bench: kind, name, firmware, serial number.
    operator: who is in charge.
    clock: name of the clock: ``real``, ``10x``, ``virtual``.
    seed: of all random numbers, on a simulated bench.
    versions: of rigctl and its dependencies, see `current_versions`.
    started: calendar time (with its zone) at which the run's time is zero.
    plan_digest: hash of the expanded plan, which is compared before a run is resumed.
    arguments: arguments of the procedure.
    calibrations: by channel, as in the rig file, with its possible range.
    source: ``bench`` for a run that was carried out, ``import`` for imported data.
    device: the device under test: ``serial_number``, ``part``, ``notes``.
    assumed: SI values, by name, of inputs that were not recorded and are known to have been constant.
    """

    id: str
    procedure: Source
    rig: Source
    layout: Layout
    started: datetime
    backend: Mapping[str, str] = field(default_factory=dict)
    operator: str = ""
    clock: str = "real"
    seed: int | None = None
    versions: Mapping[str, str] = field(default_factory=dict)
    plan_digest: str = ""
    arguments: Mapping[str, str] = field(default_factory=dict)
    calibrations: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    source: str = "bench"
    assumed: Mapping[str, float] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    device: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.started.tzinfo is None:
            raise ValueError("the start of a run needs a time zone")

    def to_json(self) -> dict[str, Any]:
        """Return the header as plain data, for the log and for run.json."""
        return {
            "id": self.id,
            "source": self.source,
            "procedure": vars(self.procedure),
            "rig": vars(self.rig),
            "layout": {
                "channels": list(self.layout.channels),
                "commands": list(self.layout.commands),
                "units": list(self.layout.units),
                "differences": sorted(self.layout.differences),
            },
            "calibrations": {name: dict(facts) for name, facts in self.calibrations.items()},
            "backend": dict(self.backend),
            "operator": self.operator,
            "clock": self.clock,
            "seed": self.seed,
            "versions": dict(self.versions),
            "started": self.started.isoformat(),
            "plan_digest": self.plan_digest,
            "arguments": dict(self.arguments),
            **({"device": dict(self.device)} if self.device else {}),
            **({"assumed": dict(self.assumed)} if self.assumed else {}),
            **({"options": dict(self.options)} if self.options else {}),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> RunHeader:
        """Read a header written by `to_json`."""
        from rigctl.rig.layout import Layout

        fields = dict(data)
        layout = fields.pop("layout")
        return cls(
            procedure=Source(**fields.pop("procedure")),
            rig=Source(**fields.pop("rig")),
            layout=Layout(
                channels=tuple(layout["channels"]),
                commands=tuple(layout["commands"]),
                units=tuple(layout["units"]),
                differences=frozenset(layout["differences"]),
            ),
            started=datetime.fromisoformat(fields.pop("started")),
            **fields,
        )


def current_versions() -> dict[str, str]:
    """Return the versions of rigctl, Python, the system and the packages that affect the results."""
    from importlib.metadata import PackageNotFoundError, version

    versions = {"python": platform.python_version(), "system": f"{platform.system()} {platform.machine()}"}
    for package in ("rigctl", "numpy", "numba", "pyarrow"):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    return versions


def source_of_rig(rig: Rig) -> Source:
    """Return the rig file as it is stored with a run."""
    return Source(rig.name, rig.text, rig.sha256, str(rig.path or ""))


def calibrations_of(rig: Rig) -> dict[str, dict[str, Any]]:
    """Return the sensor data of every channel as plain data: quantity, converter, calibration, noise,
    range."""
    return {
        name: channel.model_dump(mode="json", include={"quantity", "raw", "calibration", "noise", "range"})
        for name, channel in rig.channels.items()
    }
