"""Many independent tasks, carried out in this process, in several processes, or on a cluster.

The interface is `map_tasks`. The result of a task depends only on the task, not on the worker, the order or
the number of tasks. Its random numbers have a seed that is derived from its name (`seed_of`).
"""

from rigctl.tasks.countdown import Countdown, counted
from rigctl.tasks.mapping import map_tasks
from rigctl.tasks.seeds import seed_of
from rigctl.tasks.workers import Workers

__all__ = ["Countdown", "Workers", "counted", "map_tasks", "seed_of"]
