"""Plots of the paper's figures, from the rows of `rcdn evaluate`. The caller makes the (matplotlib) figure."""
