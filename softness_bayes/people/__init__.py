"""People's own answers, without a model of skin or receptors: means, orders, thresholds, and what the chain keeps."""
