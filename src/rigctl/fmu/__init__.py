"""FMUs: what they say of themselves, and their simulation in a process of its own."""
