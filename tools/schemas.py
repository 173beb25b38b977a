"""Writes the JSON Schemas that ship from the tables of keys: python tools/schemas.py. A test fails where one is old."""

from __future__ import annotations

import json

from sprain_cosim import mapping
from sprain_cosim.files import write
from sprain_cosim.keys import File
from sprain_cosim.scenario import file as scenario
from sprain_cosim.shipped import PACKAGE
from sprain_cosim.study import file as study
from sprain_cosim.validation.checks import user_files

FILES: tuple[File, ...] = (scenario.FILE, study.FILE, mapping.FILE, user_files.FILE)


def text(file: File) -> str:
    return json.dumps(file.schema(), indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    for file in FILES:
        path = PACKAGE / f"{file.name}.schema.json"
        write(path, text(file))
        print(f"written: {path}")
