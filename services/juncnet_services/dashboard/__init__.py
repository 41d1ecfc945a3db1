"""The dashboard: one page that shows robots and commands them, for browsers on this host."""
