"""Stepping: a system of open components, the schemes that couple them, the master that runs them, what a run leaves."""
