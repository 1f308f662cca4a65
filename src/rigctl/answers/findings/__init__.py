"""How what an analysis finds is worded: verdicts, evidence, reasons."""
