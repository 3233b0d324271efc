"""The paper's tables and figures, each from one command: its figures, ours, and the difference."""
