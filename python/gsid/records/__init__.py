"""Records: samples of input and output, the files they are read from, and their periods."""
