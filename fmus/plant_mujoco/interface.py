"""The variables of `plant`, all of them."""

from ..plant.interface import variables as variables

MODEL = "plant_mujoco"
DESCRIPTION = "The plant with MuJoCo's own dynamics in every evaluation: the reference for the plant's recursion"
