"""A measured motion as the start of a landing."""
