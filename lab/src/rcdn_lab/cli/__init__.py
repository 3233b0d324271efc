"""The commands of the laboratory: `evaluate` and `bench`."""
