"""The public names of `import rigctl`, each loaded from its module at its first use."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Any, Final

#: the location of every public name: ``module``, or ``module:name`` if its name differs there
PUBLIC: Final[Mapping[str, str]] = MappingProxyType(
    {
        # functions
        "simulate": "rigctl.runner.simulation",
        "run": "rigctl.api",
        "preview": "rigctl.planning.preview",
        "compare": "rigctl.analysis.comparison",
        "diagnose": "rigctl.analysis.diagnosis",
        "improve": "rigctl.analysis.improve",
        "survey": "rigctl.monitoring.survey",
        "fit": "rigctl.api",
        "write_report": "rigctl.report",
        # loading, finding and exporting
        "open_run": "rigctl.dataset",
        "find_runs": "rigctl.api",
        "query": "rigctl.dataset",
        "import_file": "rigctl.dataset.importing",
        "export_run": "rigctl.dataset.exporting",
        "load_model": "rigctl.model",
        "load_procedure": "rigctl.procedure.load",
        "load_rig": "rigctl.rig",
        "expand": "rigctl.procedure.expand",
        "find_effect": "rigctl.effects",
        "find_family": "rigctl.physics.families",
        # classes
        "Comparison": "rigctl.analysis.comparison_result",
        "Diagnosis": "rigctl.analysis.diagnosis_result",
        "Effect": "rigctl.effects",
        "EffectParameter": "rigctl.effects",
        "Family": "rigctl.physics.family:ModelFamily",
        "Model": "rigctl.model",
        "PluginBackend": "rigctl.backends.plugin",
        "PluginOptions": "rigctl.rig.protocols.plugin_options",
        "PluginOutput": "rigctl.rig.protocols.plugin_options",
        "PortLost": "rigctl.backends.transport.port",
        "Rig": "rigctl.rig",
        "RigctlError": "rigctl.errors",
        "Run": "rigctl.dataset",
        "Survey": "rigctl.monitoring.result",
    }
)


def load(name: str) -> Any:
    """The public name, from the module that defines it."""
    module, _, there = PUBLIC[name].partition(":")
    return getattr(import_module(module), there or name)
