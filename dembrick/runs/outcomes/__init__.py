"""Results of runs, a class for each kind of control, with their cycles and their error estimates."""
