"""Who lands: measures of a person, those of a population, and what they make of the plant."""

from .anthropometry import anthropometry
from .person import Person, Subject, base_person
from .words import parse_subject

__all__ = ["Person", "Subject", "anthropometry", "base_person", "parse_subject"]
