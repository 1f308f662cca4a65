"""Random damage, kills and broken files: one minute in CI, hours with ``make torture``."""
