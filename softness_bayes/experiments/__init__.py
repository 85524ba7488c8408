"""Choice of further touches: what ratings of them would tell, given those that exist."""
