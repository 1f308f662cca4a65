"""The engine beside what people use instead of it."""
