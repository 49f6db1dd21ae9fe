"""Boxes round the cars that the front camera of a Gantry simulator sees."""
