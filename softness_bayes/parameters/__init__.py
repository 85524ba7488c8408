"""Parameters of the model: their priors, the space of those that are sampled, and its coordinates."""
