"""onebit-design: from a plant and a network to constants one can trust."""
