"""Spectral lines of records: spectra, variances, noise and periodic disturbances."""
