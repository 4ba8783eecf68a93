"""Models of a response: rational, piecewise, MIMO; their files, conversions and tests."""
