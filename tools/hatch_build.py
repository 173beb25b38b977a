"""Builds the FMUs when a wheel is made, so that it ships them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class FmuBuildHook(BuildHookInterface):
    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if self.target_name != "wheel" or version == "editable":
            return
        sys.path.insert(0, str(Path(self.root)))
        from sprain_cosim.cosim.native_libraries import build_libraries
        from sprain_cosim.fmu.build import build_all

        build_all()
        build_libraries()
