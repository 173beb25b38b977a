"""From a description to a running instance: by version of FMI and by interface. fmpy is loaded only here and below."""

from __future__ import annotations

from ..machine.here import SYSTEM
from .description import Description
from .instance import Instance
from .library import load_fmpy


def import_libraries() -> None:
    """What opening an FMU for co-simulation imports, and what it finds out once."""
    load_fmpy()
    import fmpy.fmi2
    import fmpy.fmi3

    from ..sandbox.confinement import library_folders, python_folders
    from ..sandbox.kernel import offered
    from . import fmi2, fmi3  # noqa: F401
    from .fmi_instance import signatures

    for kind in (fmpy.fmi2.FMU2Slave, fmpy.fmi3.FMU3Slave):
        signatures(kind)
    for find_out in (offered, python_folders, library_folders, SYSTEM.resident):
        find_out()


def preload() -> None:
    """Loads what opening an FMU loads, so that what happens from then on is the FMU's doing."""
    from .messages import logger3, loggers

    import_libraries()
    from . import fmi1, model_exchange  # noqa: F401

    loggers()
    logger3()


def open_fmu(description: Description) -> Instance:
    """Loads the FMU's library into this process and instantiates it. Raises SimulationError or EnvironmentProblem."""
    kind = description.capabilities.fmi_version, description.capabilities.model_exchange
    if kind == ("2.0", False):
        from .fmi2 import Fmi2CoSimulation

        return Fmi2CoSimulation(description)
    if kind == ("3.0", False):
        from .fmi3 import Fmi3CoSimulation

        return Fmi3CoSimulation(description)
    if kind == ("1.0", False):
        from .fmi1 import Fmi1CoSimulation

        return Fmi1CoSimulation(description)
    from .model_exchange import Fmi1ModelExchange, Fmi2ModelExchange, Fmi3ModelExchange

    exchanges = {"1.0": Fmi1ModelExchange, "2.0": Fmi2ModelExchange, "3.0": Fmi3ModelExchange}
    return exchanges[kind[0]](description)
