"""The simulated world, its camera and its vehicles: pure, no clock, no process, no bus."""
