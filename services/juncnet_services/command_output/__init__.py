"""Obeys operator and pipeline on the vehicle's behalf: limits, watchdog, guard, stop latch."""
