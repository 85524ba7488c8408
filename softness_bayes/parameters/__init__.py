"""Parameters of the model: priors, the space of sampled parameters, and its coordinates."""
