"""The model of one experiment, built from scene, parameters and likelihood."""
