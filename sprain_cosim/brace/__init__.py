"""What a vendor meets: does a device fit the contract, how does it compare, how is one made."""

from __future__ import annotations
