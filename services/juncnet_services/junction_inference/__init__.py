"""Features in, a probability per class out."""
