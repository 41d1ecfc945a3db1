"""How good a model is: figures, their intervals, their pictures, and what they compare with."""
