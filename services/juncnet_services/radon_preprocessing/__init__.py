"""Frames in, network input out."""
