"""Published figures that the plots stand beside, each with its source. Facts only; no record is kept here."""

from __future__ import annotations

# Passive torque of the ankle about the body-fixed X-Y-Z Euler angles t [rad] of the calcaneus in the tibia, P(t) = a t
# + b t² + c t³ [N·m], restoring. DeMers, Hicks & Delp 2017, doi 10.1016/j.jbiomech.2016.11.002; the brace of Yoder,
# Petrella & Farrokhi 2021, doi 10.3389/fbioe.2021.765331, is P(f t).
PASSIVE = {
    "rotation_x": (9.52095038, -29.57608094, 169.01588105),
    "rotation_y": (3.61796125, -10.1612135, 64.5279144),
    "rotation_z": (5.98187224, 15.74951827, 33.6780792),
}
PASSIVE_SOURCE = "DeMers et al. 2017; Yoder et al. 2021"
BRACES = {"150 % brace": 1.5, "240 % brace": 2.4}  # angle scale f of Yoder et al. 2021

# Inversion at which ankles of cadavers failed, mean and standard deviation [deg], from the neutral pose; the range
# Yoder et al. 2021 compare with.
INJURY_INVERSION = (35.0, 6.0)

# Li, Ko, Zhang, Brown & Simpson 2018, "Biomechanics of ankle giving way", J. Sport Health Sci.: two people landing on a
# plate tilted by 25 deg. Peak inversion [deg] and peak inversion velocity [deg/s], in that laboratory's own zero.
LI_SAFE, LI_SPRAIN, LI_VELOCITY = (35.0, 43.0), 55.0, (600.0, 900.0)
LI_SOURCE = "Li et al. 2018, 25° slope"
