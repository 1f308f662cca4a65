"""The search for the effects that a model lacks: sets, refits, rivals, and how certain the answer is."""
