"""From a description to a running instance: by version of FMI and by interface. fmpy is loaded only here and below."""

from __future__ import annotations

from .description import Description
from .instance import Instance


def preload() -> None:
    """Imports what opening an FMU imports, so that what happens from then on is the FMU's doing."""
    import fmpy.fmi1
    import fmpy.fmi2
    import fmpy.fmi3
    import fmpy.logging
    import fmpy.validation  # noqa: F401

    from . import fmi1, fmi2, fmi3, model_exchange  # noqa: F401
    from .messages import logger3, loggers

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
