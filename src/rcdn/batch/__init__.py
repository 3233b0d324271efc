"""Many pictures: which they are, workers for them, what is known of them from before, and outputs that are written whole."""
