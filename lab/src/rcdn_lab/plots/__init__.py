"""Plots of the laboratory's measurements. The caller makes the (matplotlib) figure."""
