"""The page of `gsid studio`: a server on this computer only, which runs the commands of gsid in a study."""
