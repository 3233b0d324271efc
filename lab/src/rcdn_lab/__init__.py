"""The laboratory of rcdn: every figure of its documentation, for rcdn and for other detectors, each reproduced by one
command.

It adds the commands `rcdn evaluate` and `rcdn bench` to the command line (entry points of the group `rcdn.verbs`).
"""
