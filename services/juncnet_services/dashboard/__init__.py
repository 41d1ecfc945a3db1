"""The dashboard: one page that shows robots and commands them, for browsers on this host."""

NICENESS = 5
"""The flight comes first. A stop still leaves at once: it costs a millisecond of a core."""
