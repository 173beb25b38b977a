"""What `check` found about a device: the verdict, the reasons in words, the numbers behind them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any

from ..notebook import Card, Rows


@dataclass(repr=False)
class FitReport(Card):
    """A device beside the brace contract.

    - fmu: the file that was checked
    - interface: FMI version and kind; tool: the exporter that wrote it, "" where it does not say
    - profile: name of the contract's profile (None where its torques belong to none)
    - mapping: the mapping file that was used, "" without one
    - problems: keep it from fitting; warnings: a run may still be wrong; notes: what was found (one sentence each)
    - facts: measured values by name, in SI units
    - references: of each reference experiment that the FMU carries its name, the variable that differs most, value and
      expected value in its unit at time_s, difference and limit as shares of its largest value, fits
    - proposal: text of a mapping file to start from, "" where the names match
    - next_step: the command to type next
    - sha256: of the file's content, as `expect_sha256` of a mapping file takes it
    """

    fmu: str
    interface: str = ""
    tool: str = ""
    profile: str | None = None
    mapping: str = ""
    problems: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    references: list[dict[str, Any]] = field(default_factory=list)
    proposal: str = ""
    next_step: str = ""
    sha256: str = ""

    @property
    def fits(self) -> bool:
        return not self.problems

    @property
    def verdict(self) -> str:
        """fits, fits with warnings, or does not fit."""
        return "does not fit" if self.problems else "fits with warnings" if self.warnings else "fits"

    def card(self) -> tuple[str, Rows]:
        rows = [("profile", self.profile or "none")]
        for title, entries in (("problem", self.problems), ("warning", self.warnings), ("note", self.notes)):
            rows += [(f"{title} {k}", entry) for k, entry in enumerate(entries, 1)]
        return f"{self.fmu}: {self.verdict}", [*rows, *([("next", self.next_step)] if self.next_step else [])]

    def as_dict(self) -> dict[str, Any]:
        """For JSON; numbers that overflowed are null."""
        entries = {f.name: _finite(getattr(self, f.name)) for f in fields(self)}
        return {"verdict": self.verdict, "fits": self.fits, **entries}

    def text(self) -> str:
        made = f", made by {self.tool}" if self.tool else ""
        lines = [
            f"{self.fmu}: {self.verdict}",
            f"  {self.interface}{made}{f', profile {self.profile}' if self.profile else ''}",
        ]
        lines += [f"  SHA-256 {self.sha256}"] if self.sha256 else []
        for title, entries in (("problem", self.problems), ("warning", self.warnings), ("note", self.notes)):
            lines += [f"  {title + ':':9}{entry}" for entry in entries]
        if self.next_step:
            lines.append(f"\nnext: {self.next_step}")
        return "\n".join(lines)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_finite(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
