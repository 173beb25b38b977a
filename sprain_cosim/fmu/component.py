"""One FMU as an element of a system: described without running its code, judged by its files, opened."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

from . import archive, library
from .description import Description
from .element import Connector
from .instance import Instance
from .opener import open_fmu
from .sums import Summed, part_name


@dataclass(frozen=True, repr=False)
class Component(Description):
    """An FMU given a name, frozen and picklable. `read` describes it without running its code, `open` runs it.

    >>> import sprain_cosim as sc
    >>> brace = sc.Component.read("brace", "my_brace.fmu")
    >>> [connector.labelled for connector in brace.inputs.values()]
    ['rotation_x_angle [rad]', 'rotation_y_angle [rad]', 'rotation_z_angle [rad]']
    """

    own_process: ClassVar[bool] = False  # its instances live in processes of their own

    def library_problem(self) -> str:
        """Why the library cannot be used, by its file alone: not of this machine, cut off, functions of FMI that it
        does not name. Empty when nothing is wrong. Raises InputError for a damaged archive."""
        data = archive.member(self.fmu, self.library)
        damage = library.problem(data)
        if damage:
            return f"{self.library} {damage}"
        able = self.capabilities
        missing = library.missing_functions(data, able.fmi_version, able.model_exchange, self.identifier)
        if not missing:
            return ""
        few = ", ".join(missing[:3]) + (f" and {len(missing) - 3} more" if len(missing) > 3 else "")
        return f"its library lacks the FMI functions {few}; export it with all functions of {able.interface}"

    def tool_problem(self) -> str:
        """Why it cannot run without its authoring tool. Empty when it can, or when it may start programs."""
        if not self.needs_tool or self.allowed.execute:
            return ""
        return (
            f"needs its authoring tool ({self.needs_tool}) at run time; export it with the tool's stand-alone option, "
            'or, where the tool is installed here, let it start programs: allow = ["exec"] in a mapping file'
        )

    def complaints(self) -> list[str]:
        """What fmpy's validation finds wrong with the description; nothing is loaded."""
        from fmpy.validation import validate_fmu

        return [str(problem) for problem in validate_fmu(str(self.fmu))]

    def open(self) -> Instance:
        """Loads the FMU's code into this process and instantiates it. Raises SimulationError or EnvironmentProblem."""
        if not self._sums:
            return open_fmu(self)
        parts = {part_name(name, part): part for name, several in self._sums.items() for part in several}
        return Summed(open_fmu(replace(self, connectors={**self.connectors, **parts})), self._sums)

    @cached_property
    def _sums(self) -> dict[str, tuple[Connector, ...]]:
        return {name: connector.parts for name, connector in self.connectors.items() if connector.parts}
