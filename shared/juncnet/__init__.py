"""JuncNet: road junction disambiguation for autonomous vehicles."""
