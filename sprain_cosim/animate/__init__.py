"""The landing in slow motion."""
