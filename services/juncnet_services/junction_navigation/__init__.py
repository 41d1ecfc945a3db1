"""Counts junctions and takes the turns of a mission: from scores and road commands to velocities."""
