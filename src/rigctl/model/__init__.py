"""A model: a family's base equations, effects, and the values of their parameters."""

from rigctl.model.build import Effects, build_system, superset
from rigctl.model.inputs import InputSource, input_sources, input_values
from rigctl.model.load import load_model, parse_model
from rigctl.model.model import Model, Value
from rigctl.model.plant import PlantInputs, initial_state, plant_inputs, plant_stepper
from rigctl.model.rig_family import family_of
from rigctl.model.values import parameter_values

__all__ = [
    "Effects",
    "InputSource",
    "Model",
    "PlantInputs",
    "Value",
    "build_system",
    "family_of",
    "initial_state",
    "input_sources",
    "input_values",
    "load_model",
    "parameter_values",
    "parse_model",
    "plant_inputs",
    "plant_stepper",
    "superset",
]
