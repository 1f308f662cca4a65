"""A recorded run played back as a bench, without model or engine."""
