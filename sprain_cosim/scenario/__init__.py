"""One landing, described: the scenario and its file."""

from .file import load_scenario
from .scenario import Scenario, Session, Value, parse_value

__all__ = ["Scenario", "Session", "Value", "load_scenario", "parse_value"]
