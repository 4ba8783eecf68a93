"""Lines of records: spectra, variances, noise and tones."""
