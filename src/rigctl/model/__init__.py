"""A model: a family's base equations, effects, and the values of their parameters."""

from rigctl.model.build import Effects, build_system, superset
from rigctl.model.difference import ModelDifference, difference
from rigctl.model.history.change import Change, ModelError
from rigctl.model.history.errors import VersionError, version_errors
from rigctl.model.history.save import load_version, save_version
from rigctl.model.history.store import current_version, find_version, versions
from rigctl.model.history.version import Version, VersionValue
from rigctl.model.inputs import InputSource, input_sources, input_values
from rigctl.model.load import load_model, parse_model
from rigctl.model.model import Model, Value
from rigctl.model.plant import PlantInputs, initial_state, plant_inputs, plant_stepper
from rigctl.model.rig_family import family_of
from rigctl.model.value_table import StatedValue, stated_values
from rigctl.model.values import parameter_values

__all__ = [
    "Change",
    "Effects",
    "InputSource",
    "Model",
    "ModelDifference",
    "ModelError",
    "PlantInputs",
    "StatedValue",
    "Value",
    "Version",
    "VersionError",
    "VersionValue",
    "build_system",
    "current_version",
    "difference",
    "family_of",
    "find_version",
    "initial_state",
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
