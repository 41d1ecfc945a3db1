"""Data and training; needs the extra `[train]`."""
