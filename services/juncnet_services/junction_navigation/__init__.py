"""Counts junctions and takes the turns of a mission."""
