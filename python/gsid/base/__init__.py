"""Errors, argument checks, frequency bands and files, used by all other packages."""
