"""The cost of an FMU as the model, in comparisons and diagnoses."""
