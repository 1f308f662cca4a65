"""Every public name as a type checker sees it: mypy reads this file, and nothing runs it."""

from __future__ import annotations

import rigctl
import rigctl.testing

PUBLIC: tuple[object, ...] = (
    rigctl.simulate,
    rigctl.run,
    rigctl.preview,
    rigctl.compare,
    rigctl.diagnose,
    rigctl.improve,
    rigctl.survey,
    rigctl.fit,
    rigctl.write_report,
    rigctl.open_run,
    rigctl.find_runs,
    rigctl.query,
    rigctl.import_file,
    rigctl.export_run,
    rigctl.load_model,
    rigctl.load_procedure,
    rigctl.load_rig,
    rigctl.expand,
    rigctl.find_effect,
    rigctl.find_family,
    rigctl.Comparison,
    rigctl.Diagnosis,
    rigctl.Effect,
    rigctl.EffectParameter,
    rigctl.Family,
    rigctl.Model,
    rigctl.PluginBackend,
    rigctl.PluginOptions,
    rigctl.PluginOutput,
    rigctl.PortLost,
    rigctl.Rig,
    rigctl.RigctlError,
    rigctl.Run,
    rigctl.Survey,
)


def from_a_file_to_a_verdict(path: str, family: rigctl.Family) -> rigctl.Diagnosis:
    model: rigctl.Model = rigctl.load_model(path)
    assert model.family == family
    run: rigctl.Run = rigctl.simulate("stroke.yaml").run
    return rigctl.diagnose([run], model)


def what_is_not_there() -> object:
    return rigctl.compere  # type: ignore[attr-defined]
