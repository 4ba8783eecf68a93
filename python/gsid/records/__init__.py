"""Records of input and output samples: data structure, files, and division into periods."""
