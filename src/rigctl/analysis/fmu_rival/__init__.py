"""A third party's FMU compared with a model, on the same records."""

from rigctl.analysis.fmu_rival.judge import FmuRival, judge_fmu
from rigctl.analysis.fmu_rival.run import require_fmu

__all__ = ["FmuRival", "judge_fmu", "require_fmu"]
