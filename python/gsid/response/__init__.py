"""Measured frequency responses: one input and output, several, and their noise and distortion."""
