"""From a receptor current to a firing rate: the membrane of a touch receptor's afferent, and its fast rate curves."""
