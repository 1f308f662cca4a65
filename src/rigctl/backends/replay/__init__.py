"""A recorded run, played as if it were the bench; no model and no engine is involved."""
