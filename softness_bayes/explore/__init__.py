"""Fast model in the hand: a page of sliders on this machine, and what it shows."""
