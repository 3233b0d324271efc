"""The verbs of the laboratory: `evaluate` and `bench`."""
