"""Recorded afferents: firing rates of single nerve fibres under rigid probes, and what the chain says of them."""
