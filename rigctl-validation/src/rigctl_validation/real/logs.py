"""The real logs: what is known of each bench, which answers are right, and the errors of the best models.

The data are not part of rigctl; `benchmarks/real` says where each log was published, under which licence, and
makes the files of the folder that the environment variable RIGCTL_REAL_DATA names.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final

from rigctl.errors import RigctlError, unknown_name

#: the environment variable with the folder of the logs
FOLDER_VARIABLE: Final = "RIGCTL_REAL_DATA"
_FILES = Path(__file__).parent / "files"


@dataclass(frozen=True)
class RealLog:
    """A log of a real bench.

    Attributes
    ----------
    name: also of its folder of data, and of its project files.
    truth: what is known of the bench, in words.
    channel, unit: the channel whose error counts.
    right: patterns of names of effects that are a right answer, alone or in a class.
    known: for each unseen part, the error of the base model and of the best known one, RMSE of a simulation.
    fit: which of these are errors on the log itself, because nothing else was measured.
    """

    name: str
    title: str
    truth: str
    channel: str
    unit: str
    right: tuple[str, ...]
    known: Mapping[str, tuple[float, float]]
    fit: bool = False

    def file(self, name: str) -> Path:
        """A file of its user: ``family.yaml``, ``rig.yaml`` or ``model.yaml``."""
        return _FILES / self.name / name

    def is_right(self, effects: Sequence[str] | frozenset[str]) -> bool:
        """True if one of these effects is a right answer."""
        return any(fnmatchcase(effect, pattern) for effect in effects for pattern in self.right)


_FRICTION = ("coulomb_*", "stribeck_*", "viscous_*", "quadratic_drag_*")
_MEMORY = ("hysteresis_*", "lag_*", "backlash_*", "storage_*", "dead_time_*")

_LOGS = (
    RealLog(
        "dryer",
        "hair dryer",
        "heater voltage of two levels to air temperature: a dead time and a second lag",
        "thermocouple",
        "V",
        ("dead_time_of_heater_voltage", "lag_*", "storage_on_thermocouple"),
        {"second half": (0.413, 0.120)},
    ),
    RealLog(
        "ced",
        "coupled electric drives",
        "the reading is the modulus of the speed, and the drives are of third order",
        "pulley_speed",
        "V",
        _MEMORY,
        {"the log itself": (0.61, 0.23)},
        fit=True,
    ),
    RealLog(
        "damper",
        "magneto-rheological damper",
        "hysteresis of the force over the velocity (Bouc-Wen)",
        "force",
        "N",
        (*_MEMORY, *_FRICTION),
        {"last 1499 rows": (35.1, 10.6)},
    ),
    RealLog(
        "hoop",
        "hoop on a motor",
        "viscous and quadratic drag, dry friction and a lag",
        "speed",
        "rad/s",
        (*_FRICTION, *_MEMORY),
        {"random steps": (0.93, 0.45)},
    ),
    RealLog(
        "oring",
        "pneumatic cylinder with an O-ring",
        "friction of the seal with the sign of the motion: 6.5, 8.0, 9.3 and 11.3 N at 1, 3, 5 and 7 bar",
        "force",
        "N",
        ("coulomb_*", "stribeck_*", "hysteresis_*", "backlash_*"),
        {"the log itself": (10.8, 2.0)},
        fit=True,
    ),
    RealLog(
        "silverbox",
        "Silverbox",
        "Duffing's equation: a cubic spring",
        "output",
        "mV",
        ("cubic_stiffness_on_slope",),
        {"multisine 10": (7.4, 0.51), "arrow": (14.2, 0.57)},
    ),
    RealLog(
        "emps",
        "electro-mechanical positioning system",
        "dry friction, not the same in both directions, an offset, and something more",
        "position",
        "mm",
        (*_FRICTION, "hysteresis_on_velocity", "offset_*", "lag_*", "dead_time_*"),
        {"pulses": (6.8, 4.0)},
    ),
)

LOGS: Final[Mapping[str, RealLog]] = {log.name: log for log in _LOGS}


def find_log(name: str) -> RealLog:
    """The log of this name.

    Raises
    ------
    RigctlError
        there is none.
    """
    if name not in LOGS:
        raise unknown_name("real log", name, LOGS)
    return LOGS[name]


def data_folder() -> Path:
    """The folder of the logs.

    Raises
    ------
    RigctlError
        the environment variable does not name a folder.
    """
    stated = os.environ.get(FOLDER_VARIABLE, "")
    if not stated or not Path(stated).is_dir():
        raise RigctlError(
            "the real logs are not part of rigctl, and no folder holds them",
            value=f"{FOLDER_VARIABLE}={stated}" if stated else f"{FOLDER_VARIABLE} is not set",
            expected=f"{FOLDER_VARIABLE} names a folder with one folder for each log",
            hint="benchmarks/real/README.md says where they are published, and how to prepare them",
        )
    return Path(stated)
