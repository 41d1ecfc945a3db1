"""Every message of a flight into MCAP files."""
