"""One HTML file to send."""
