"""The law of an effect: its model discrepancy, the law that the data support, and the effect file offered."""
