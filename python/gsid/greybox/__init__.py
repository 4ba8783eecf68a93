"""Grey-box fits: the physical parameters of a plant, estimated from records."""
