"""Many independent pieces of work: here, in processes of this computer, or on a cluster.

`map_tasks` is all there is. What comes of a piece depends on the piece alone: not on where it was worked on,
in which order, or how many others there are. Whatever is random in it begins at `seed_of` its name.
"""

from rigctl.tasks.mapping import map_tasks
from rigctl.tasks.seeds import seed_of
from rigctl.tasks.workers import Workers

__all__ = ["Workers", "map_tasks", "seed_of"]
