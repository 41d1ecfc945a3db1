"""`juncnet doctor`: what is wrong with a layout before flight, and what helps."""
