"""What to measure next: records, or a sensor, that would distinguish the remaining explanations."""
