"""Stands for the drone, camera included; only in simulation."""
