"""rigctl: run physical test benches, compare a model with what was measured, learn what is missing."""

from typing import TYPE_CHECKING, Any

from rigctl.public_names import PUBLIC, load

if TYPE_CHECKING:
    from rigctl.analysis.comparison import compare as compare
    from rigctl.analysis.comparison_result import Comparison as Comparison
    from rigctl.analysis.diagnosis import diagnose as diagnose
    from rigctl.analysis.diagnosis_result import Diagnosis as Diagnosis
    from rigctl.analysis.improve import improve as improve
    from rigctl.api import find_runs as find_runs
    from rigctl.api import fit as fit
    from rigctl.api import run as run
    from rigctl.backends.plugin import PluginBackend as PluginBackend
    from rigctl.backends.transport.port import PortLost as PortLost
    from rigctl.dataset import Run as Run
    from rigctl.dataset import open_run as open_run
    from rigctl.dataset import query as query
    from rigctl.dataset.exporting import export_run as export_run
    from rigctl.dataset.importing import import_file as import_file
    from rigctl.effects import Effect as Effect
    from rigctl.effects import EffectParameter as EffectParameter
    from rigctl.effects import find_effect as find_effect
    from rigctl.errors import RigctlError as RigctlError
    from rigctl.model import Model as Model
    from rigctl.model import load_model as load_model
    from rigctl.monitoring.result import Survey as Survey
    from rigctl.monitoring.survey import survey as survey
    from rigctl.physics.families import find_family as find_family
    from rigctl.physics.family import ModelFamily
    from rigctl.planning.preview import preview as preview
    from rigctl.procedure.expand import expand as expand
    from rigctl.procedure.load import load_procedure as load_procedure
    from rigctl.report import write_report as write_report
    from rigctl.rig import Rig as Rig
    from rigctl.rig import load_rig as load_rig
    from rigctl.rig.protocols.plugin_options import PluginOptions as PluginOptions
    from rigctl.rig.protocols.plugin_options import PluginOutput as PluginOutput
    from rigctl.runner.simulation import simulate as simulate

    Family = ModelFamily

__all__ = list(PUBLIC)


if not TYPE_CHECKING:  # so that a type checker reports an unknown name

    def __getattr__(name: str) -> Any:
        """A public name, loaded at its first use."""
        if name not in PUBLIC:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = load(name)
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *PUBLIC})
