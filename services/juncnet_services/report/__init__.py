"""The report of a recorded flight: one HTML file that needs nothing else, and its pictures."""
