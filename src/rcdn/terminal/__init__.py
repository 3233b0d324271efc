"""Common parts of the command line's verbs: options, messages and progress on the terminal, robust output streams."""
