"""Fits of rational models to measured frequency responses, and tests of these fits."""
