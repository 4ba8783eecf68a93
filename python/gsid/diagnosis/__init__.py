"""Which physical effect is missing from a model, and what adding it does to the error."""
