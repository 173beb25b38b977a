"""Files and samples for other programs."""
