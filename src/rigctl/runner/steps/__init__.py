"""What each action does on the bench: one generator per action, one file each."""

from rigctl.runner.steps.behaviours import behaviour

__all__ = ["behaviour"]
