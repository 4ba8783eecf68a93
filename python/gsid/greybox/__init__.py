"""Fits of a plant's parameters to records."""
