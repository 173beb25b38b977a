"""Tests that need the reference numbers skip where the folder is absent."""

from __future__ import annotations

import pytest

from tools.reference import FOLDER

needs_reference = pytest.mark.skipif(not FOLDER.is_dir(), reason="reference numbers not found (set SPRAIN_REFERENCE)")
