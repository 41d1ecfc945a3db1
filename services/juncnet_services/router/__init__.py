"""The door for outsiders: viewers, subscribers in any language, tools on other hosts."""
