"""Pictures for people: overlays of what was found (`overlay`) and boards to print (`target`)."""
