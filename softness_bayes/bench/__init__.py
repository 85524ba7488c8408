"""Time and error of the forward model on this machine, beside programs that simulate every receptor."""
