"""A study: one folder with records, models and results, and the commands that made them."""
