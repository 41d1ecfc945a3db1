"""A user's own footage: which frames are kept, what they show, and on which side they stand."""
