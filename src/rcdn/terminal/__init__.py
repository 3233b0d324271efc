"""What all verbs say and ask in the same way: options, lines and progress on the terminal, streams that may be closed."""
