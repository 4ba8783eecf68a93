"""Frequency responses measured: of one input and output, of several, with noise and distortion."""
