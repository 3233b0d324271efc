"""The paper's tables and figures, each reproduced by one command: its figures, ours, and the difference."""
