"""Plants as stacks of physical effects, and their responses."""
