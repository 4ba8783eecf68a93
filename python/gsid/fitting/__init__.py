"""Fits of rational models to measured responses."""
