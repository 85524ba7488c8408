"""The model of one experiment: scene, parameters and likelihood put together."""
