"""Results of runs, a class for each thing that drives one, with their work in cycles and their errors."""
