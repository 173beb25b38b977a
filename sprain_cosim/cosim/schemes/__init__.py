"""Coupling schemes, one module each; protocol.py says what a scheme is."""
