"""How an integration ends and what is counted: plain numbers that kernels and Python share."""

#: how an integration ends
DONE, STEP_TOO_SMALL, NOT_FINITE_RHS, TOO_MANY_STEPS, NOT_FINITE_DELAY, TOO_MANY_COMMANDS = range(6)

#: places in the counters: steps taken, steps rejected, restarts, and the state that made it fail
STEPS, REJECTED, RESTARTS, GUILTY_STATE = range(4)
COUNTERS = 4
