"""The laboratory of rcdn: every figure of its documentation, ours beside others, each by one command.

It adds the verbs `rcdn evaluate` and `rcdn bench` to the command line (entry points of the group `rcdn.verbs`).
"""
