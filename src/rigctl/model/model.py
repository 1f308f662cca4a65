"""A model: the contents of its file, checked and in SI. Models are immutable; a change makes a new one.

In: what `load` has read, or Python functions (`Model.from_function`). Out: the equations (`Model.system`),
every value of them (`Model.values`), which of these a fit may change (`Model.fitted`), and which are only
assumed (`Model.assumed`). A changed model still has the text of its file: `writing.update` puts only what
differs into it, so that comments and layout are those of its user.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from rigctl.argument_types import checks_argument_types
from rigctl.effects.contradiction import refuse_contradictions
from rigctl.effects.declaration import Effect, qualified
from rigctl.effects.registry import find_effect, library
from rigctl.engine.least_squares.unknown import Prior
from rigctl.engine.system import System
from rigctl.errors import RigctlError, unknown_name
from rigctl.files.version_suffix import split_version
from rigctl.foreign.process import PATIENCE
from rigctl.model.build import build_system, superset
from rigctl.model.values import parameter_values
from rigctl.notebook import as_html, one_line
from rigctl.physics.families import using_families
from rigctl.physics.family import ModelFamily
from rigctl.physics.python_functions import Declared, UserFunction, family_from_functions
from rigctl.physics.standing import STANDINGS, Standing, range_of
from rigctl.rig.load import load_rig
from rigctl.rig.rig import Rig

if TYPE_CHECKING:
    import pandas as pd


#: end of the `source` of a value that a fit left where it was, because the data determine only combinations
NOT_DETERMINED = "which does not determine it by itself"


@dataclass(frozen=True)
class Value:
    """A parameter's value in SI, and its uncertainty.

    Attributes
    ----------
    fit: whether a fit may change it.
    std: its standard deviation, SI; None if unknown.
    source: its origin, in words.
    unit: the unit in the model file; empty if it is not in the file.
    prior: prior knowledge, SI: every fit weighs it with the data.
    standing: how well it is known, where the file says it.
    range: of an assumed value, SI, where the file states it.
    """

    si: float
    fit: bool = False
    std: float | None = None
    source: str = ""
    unit: str = ""
    prior: Prior | None = None
    standing: Standing = ""
    range: tuple[float, float] | None = None

    @property
    def undetermined(self) -> bool:
        """Whether the data to which it was fitted do not determine it."""
        return self.source.endswith(NOT_DETERMINED)


@dataclass(frozen=True)
class Model:
    """A family with a bench, parameters and effects.

    Attributes
    ----------
    family: of its equations.
    rig: the bench, which gives dimensions and channels; None for a model without a bench.
    oil: the fluid, if not the rig's.
    parameters: of the family, as given in the file.
    effects: by name, each with all of its parameters.
    own_effects: the user's own effects that `effects` may name besides the library's.
    path: the file, if there is one; ``m.yaml@3`` for its version 3.
    text: of the file, layout and comments included.
    """

    family: ModelFamily
    rig: Rig | None = None
    oil: str | None = None
    parameters: Mapping[str, Value] = field(default_factory=dict)
    effects: Mapping[str, Mapping[str, Value]] = field(default_factory=dict)
    description: str = ""
    path: Path | None = None
    own_effects: tuple[Effect, ...] = ()
    text: str = ""

    @classmethod
    def from_function(
        cls,
        rates: UserFunction | None,
        readings: UserFunction,
        *,
        rig: Rig | str | Path,
        states: Mapping[str, Declared],
        inputs: Mapping[str, Declared],
        parameters: Mapping[str, Declared],
        outputs: Mapping[str, str],
        name: str = "python_model",
        time_limit: float = PATIENCE,
    ) -> Model:
        """A model whose equations are Python functions.

        ``dx/dt = rates(t, x, u, p)``, ``y = readings(x, u, p)``. Both are called with symbols in place of SI
        numbers, and have exact derivatives and compiled speed; states x, inputs u and parameters p are taken
        by name, ``p.mass``. They return a dict by name, or values in the order declared.

        Functions that take no symbols, because they branch, look a table up or call another library, are
        called with numbers in processes of their own. Derivatives are then differences that are checked, and
        effects are looked for at inputs, readings and parameters alone; the model says so.

        Parameters
        ----------
        rates: None for a model without states.
        rig: the bench, or its file, whose channels and actuators have the names of outputs and inputs.
        states: the start of each, ``"0 V"``, or with a change that matters: ``("0 V", "0.01 V")``.
        inputs: the value of each when nothing is commanded, with its unit.
        parameters: ``"9.81 m/s^2"`` is exact; ``("2 ohm", "0.1 ohm", "50 ohm")`` is fitted within bounds.
        outputs: the unit of each, ``"rad/s"``.
        time_limit: s, for one simulation of a record by functions that are called with numbers.

        Raises
        ------
        RigctlError
            a declaration is wrong, an equation has another dimension than its result, or a function fails,
            depends on the time, or needs too long.
        """
        family = family_from_functions(
            name,
            rates,
            readings,
            states=states,
            inputs=inputs,
            parameters=parameters,
            outputs=outputs,
            time_limit=time_limit,
        )
        # the rig file may name this family, which is in no file
        with using_families(family):
            bench = rig if isinstance(rig, Rig) else load_rig(Path(rig))
        free = {one.name: Value(one.value, fit=True) for one in family.parameters if not one.fixed}
        return cls(family, bench, parameters=free)

    @property
    def name(self) -> str:
        """The file's name without its ending (``m@3`` for a version of it), or the family's."""
        if self.path is None:
            return self.family.name
        head, number = split_version(self.path)
        return head.stem if number is None else f"{head.stem}@{number}"

    @cached_property
    def values(self) -> Mapping[str, float]:
        """Every parameter of its system in SI, effects' under their qualified names."""
        given = {name: value.si for name, value in self.parameters.items()}
        values = parameter_values(self.family, self.rig, given, self.oil)
        for effect, parameters in self.effects.items():
            values |= {qualified(effect, name): value.si for name, value in parameters.items()}
        return MappingProxyType(values)

    @checks_argument_types
    def effect(self, name: str) -> Effect:
        """The effect called `name`: the user's own, or the library's.

        Raises
        ------
        RigctlError
            there is none; the message gives the nearest name.
        """
        users = {effect.name: effect for effect in self.own_effects}
        return users[name] if name in users else find_effect(name, self.family)

    def same_bench(self, other: Model) -> bool:
        """Whether both describe one bench: data read for one are those of the other.

        Names do not decide: two versions of a family file may have one.
        """
        return self.rig == other.rig and (self.family is other.family or self.family == other.family)

    @property
    def with_laws(self) -> tuple[str, ...]:
        """The effects in the model with terms in its equations."""
        return tuple(name for name in self.effects if self.effect(name).terms)

    @property
    def fitted(self) -> tuple[str, ...]:
        """The parameters that a fit may change, by the names of `values`."""
        free = [name for name, value in self.parameters.items() if value.fit]
        for effect, parameters in self.effects.items():
            free += [qualified(effect, name) for name, value in parameters.items() if value.fit]
        return tuple(free)

    @cached_property
    def assumed(self) -> Mapping[str, tuple[float, float]]:
        """The assumed parameters that no fit changes, with their ranges, SI: unknowns of every fit.

        A value of the model file without a standing has that of the family if it is the same value. Others,
        and those of the rig and of the oil, count as exact.
        """
        ranges = {}
        for declared in self.family.parameters:
            given = self.parameters.get(declared.name)
            value = self.values[declared.name]
            # a standing belongs to a value: another value than the family's was put there by somebody who
            # knew it, and has none unless the file states one
            same = value == declared.value
            standing = (given.standing if given is not None else "") or (declared.standing if same else "")
            if standing != "assumed" or (given is not None and given.fit) or declared.fixed:
                continue
            stated = given.range if given is not None else None
            stated = stated or (declared.range if same else None)
            limits = range_of(declared.name, value, declared.unit, standing, stated)
            if limits is not None:
                ranges[declared.name] = limits
        return MappingProxyType(ranges)

    def __repr__(self) -> str:
        """One-line representation."""
        effects = f" with {', '.join(self.effects)}" if self.effects else ""
        program = self.family.program
        by = f", called with numbers: {program.why}" if program is not None and program.why else ""
        return one_line(self, f"{self.name}: {self.family.name}{effects}, {len(self.fitted)} free{by}")

    def summary(self) -> str:
        """Its family, bench, effects and how many parameters a fit may change."""
        bench = f" on '{self.rig.name}'" if self.rig is not None else ""
        effects = ", ".join(self.effects) or "none"
        return (
            f"{self.name}: {self.family.title}{bench}\neffects: {effects}; {len(self.fitted)} free parameters"
        )

    def frame(self) -> pd.DataFrame:
        """Every parameter in its display unit: its value, uncertainty and source."""
        import pandas as pd

        from rigctl.model.value_table import stated_values

        rows = [
            {
                "parameter": one.name,
                "value": one.value,
                "unit": one.unit,
                "std": one.std_value,
                "free": one.fit,
                "origin": one.origin,
                "meaning": one.meaning,
            }
            for one in stated_values(self)
        ]
        return pd.DataFrame(rows).astype({"std": "float64"})

    def _repr_html_(self) -> str:
        """The summary and the parameters, as a notebook shows them."""
        return as_html(self.summary(), self.frame())

    def system(self, *, library: bool = False) -> System:
        """Its equations; with `library`, they include every other effect at its null, also the user's own.

        Raises
        ------
        RigctlError
            an effect's term cannot be added.
        """
        effects = {
            name: {parameter: value.si for parameter, value in parameters.items()}
            for name, parameters in self.effects.items()
        }
        return build_system(
            self.family,
            superset(self.family, effects, self.own_effects) if library else effects,
            self.rig,
            parameters={name: value.si for name, value in self.parameters.items()},
            oil=self.oil,
            own_effects=self.own_effects,
        )

    @checks_argument_types
    def with_effect(
        self, name: str | Effect, values: Mapping[str, float], *, fit: bool = True, shapes: bool = False
    ) -> Model:
        """The model with one more effect, given by name or as a user's own.

        Parameters missing in `values` (SI) have their typical size. Base physics that was removed is restored
        with the family's default values. With `fit`, later fits may change the effect's parameters; with
        `shapes`, also its shape parameters.

        Raises
        ------
        RigctlError
            the effect or a parameter of it is unknown, the model has it already, or it contradicts another.
        """
        if isinstance(name, Effect):
            return self._knowing(name).with_effect(name.name, values, fit=fit, shapes=shapes)
        effect = self.effect(name)
        # base physics is not among `effects`: it is absent where its parameters are at their null
        removed = effect.base and all(self.values[each] == nothing for each, nothing in effect.base.items())
        if removed:
            return self._with_base(effect, present=True)
        if effect.base or name in self.effects:
            raise RigctlError("the model has this effect already", value=name)
        refuse_contradictions([*map(self.effect, self.effects), effect])
        for parameter in values:
            effect.parameter(parameter)
        settings = {
            p.name: Value(float(values.get(p.name, p.start)), fit and (shapes or not p.shape))
            for p in effect.parameters
        }
        return replace(self, effects=MappingProxyType({**self.effects, name: settings}))

    @checks_argument_types
    def without_effect(self, name: str) -> Model:
        """The model without an effect; base physics is removed by its null value.

        Raises
        ------
        RigctlError
            the model does not have it.
        """
        if name in self.effects:
            rest = {other: values for other, values in self.effects.items() if other != name}
            return replace(self, effects=MappingProxyType(rest))
        base = {known.name: known for known in library(self.family).values() if known.base}
        if name not in base:
            raise unknown_name("effect of this model", name, [*self.effects, *base])
        return self._with_base(base[name], present=False)

    @checks_argument_types
    def with_values(
        self,
        values: Mapping[str, float],
        *,
        std: Mapping[str, float] | None = None,
        source: str = "",
        undetermined: Collection[str] = (),
    ) -> Model:
        """The model with other values (SI, names as in `values`); which parameters are free stays unchanged.

        Parameters
        ----------
        std: the standard deviations of the new values (SI, the same names), as far as known. The previous
            uncertainty of a changed value no longer applies.
        source: the origin of the new values.
        undetermined: those that this origin does not determine by themselves; said in their sources.

        Raises
        ------
        RigctlError
            a name is none of the model's.
        """
        parameters = dict(self.parameters)
        effects = {effect: dict(known) for effect, known in self.effects.items()}
        for name, value in values.items():
            if name not in self.values:
                raise unknown_name("parameter of the model", name, self.values)
            # ``effect.parameter`` or a parameter of the family
            effect, dot, parameter = name.partition(".")
            where = effects[effect] if dot else parameters
            key = parameter if dot else name
            origin = f"{source}, {NOT_DETERMINED}" if name in undetermined else source
            given = Value(float(value), std=(std or {}).get(name), source=origin)
            old = where.get(key, Value(self.values[name]))
            # a value set to what it was, from nowhere else, keeps its uncertainty and its origin; a new one
            # keeps what its user wrote of it: whether it is free, its unit, its prior, its range as long as
            # it lies within
            if key not in where or given != Value(old.si):
                limits = old.range or self.assumed.get(name)
                where[key] = replace(
                    given,
                    fit=old.fit,
                    unit=old.unit,
                    prior=old.prior,
                    standing="assumed" if name in self.assumed else old.standing,
                    range=limits if limits is None or limits[0] <= given.si <= limits[1] else None,
                )
        return replace(self, parameters=MappingProxyType(parameters), effects=MappingProxyType(effects))

    @checks_argument_types
    def with_standing(self, name: str, standing: str) -> Model:
        """The model with another standing of a parameter of its family; a range stays only of an assumed one.

        Raises
        ------
        RigctlError
            there is no such parameter or standing, or the parameter is a number in the equations.
        """
        if standing not in STANDINGS:
            raise unknown_name("standing", standing, STANDINGS)
        declared = self.family.parameter(name)
        if standing == "assumed" and declared.fixed:
            raise RigctlError(f"{name} is a number in the equations", hint="Write it in the family file")
        value = self.values[name]
        old = self.parameters.get(name, Value(value))
        limits = self.assumed.get(name, old.range) if standing == "assumed" else None
        range_of(name, value, declared.unit, STANDINGS[standing], limits)
        changed = replace(old, standing=STANDINGS[standing], range=limits)
        return replace(self, parameters=MappingProxyType({**self.parameters, name: changed}))

    def _knowing(self, effect: Effect) -> Model:
        """The model with `effect` among those that it may name, unless the library has it."""
        if library(self.family).get(effect.name) is effect:
            return self
        known = {each.name: each for each in (*self.own_effects, effect)}
        return replace(self, own_effects=tuple(known.values()))

    def _with_base(self, effect: Effect, *, present: bool) -> Model:
        usual = parameter_values(self.family, self.rig, None, self.oil)
        changed = {name: usual[name] if present else nothing for name, nothing in effect.base.items()}
        model = self.with_values(changed)
        settings = {
            name: replace(value, fit=value.fit and present) if name in changed else value
            for name, value in model.parameters.items()
        }
        return replace(model, parameters=MappingProxyType(settings))
