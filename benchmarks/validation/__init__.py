"""How often diagnoses are right: trials of `rigctl validate`, the source of the documentation's tables."""
