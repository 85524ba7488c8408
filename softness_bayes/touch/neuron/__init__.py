"""From receptor current to firing rate: membrane model of a touch afferent, and its precomputed rate curves."""
