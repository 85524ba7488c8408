"""Independent implementations that the package is compared with."""
