"""Motion out of a history: where blocks and joints are in a frame, and what a joint carries there."""
