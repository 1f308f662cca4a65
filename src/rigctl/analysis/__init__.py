"""From a fitted model to a verdict: does it agree, where does it fail, and which effect is missing."""
