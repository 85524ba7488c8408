"""Interactive exploration of the model: a local web page of sliders and charts."""
