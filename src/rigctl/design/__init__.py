"""What to measure next: records, or a sensor, that would tell the explanations that are left apart."""
