"""Keeps the robot on the road: the seam for followers, and the built-in one."""
