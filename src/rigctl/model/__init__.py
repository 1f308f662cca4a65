"""A model: a family's base equations, effects, and the values of their parameters."""

from rigctl.model.build import build_system, superset
from rigctl.model.difference import difference
from rigctl.model.history.change import Change, ModelError
from rigctl.model.history.errors import VersionError, version_errors
from rigctl.model.history.save import load_version, save_version
from rigctl.model.history.store import current_version, find_version, versions
from rigctl.model.history.version import Version
from rigctl.model.inputs import input_sources, input_values
from rigctl.model.load import load_model, parse_model
from rigctl.model.model import Model
from rigctl.model.plant import plant_inputs, plant_stepper
from rigctl.model.rig_family import family_of
from rigctl.model.value_table import StatedValue, stated_values
from rigctl.model.values import parameter_values

__all__ = [
    "Change",
    "Model",
    "ModelError",
    "StatedValue",
    "Version",
    "VersionError",
    "build_system",
    "current_version",
    "difference",
    "family_of",
    "find_version",
    "input_sources",
    "input_values",
    "load_model",
    "load_version",
    "parameter_values",
    "parse_model",
    "plant_inputs",
    "plant_stepper",
    "save_version",
    "stated_values",
    "superset",
    "version_errors",
    "versions",
]
