"""Linear structure of an axis from its records: rational fits, physical readings, selection."""
