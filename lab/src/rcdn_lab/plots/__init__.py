"""Plots of what the laboratory measures. The caller makes the (matplotlib) figure."""
