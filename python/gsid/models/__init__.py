"""Models of a response: rational, piecewise, with several inputs and outputs; their files and forms."""
