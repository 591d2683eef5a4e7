"""Motion in a history: positions of blocks and joints in a frame, and the forces of the joints there."""
