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
POSTURE = ("plant.talocrural_angle_at_contact", "plant.subtalar_angle_at_contact")
PASSIVE_SOURCE = "DeMers et al. 2017; Yoder et al. 2021"
BRACES = {"150 % brace": 1.5, "240 % brace": 2.4}  # angle scale f of Yoder et al. 2021

# Importance of the inputs at the levels of the advanced mean value method, as Yoder et al. 2021 found it for study 6:
# components of a unit vector, from the design points of the authors' runs (5 and 95 %) and from their steps (50 %). The
# six other inputs have 0 there: the outputs were rounded to 0.1 deg, the steps a tenth of an SD.
AUTHORS_IMPORTANCE = {
    level: dict(zip(("plant.drop_height", "controller.coactivation", *POSTURE), values, strict=True))
    for level, values in {
        "5": (0.66, -0.47, 0.41, 0.41),
        "50": (0.76, -0.38, 0.38, 0.38),
        "95": (0.83, -0.28, 0.34, 0.34),
    }.items()
}

# Inversion at which ankles of cadavers failed, mean and standard deviation [deg], from the neutral pose; and the moment
# that the passive ankle bears about the inversion axis at injury, ends of a range [N·m]. What Yoder et al. 2021 compare
# with.
INJURY_INVERSION = (35.0, 6.0)
INJURY_MOMENT = (2.7, 4.3)
INJURY_INVERSION_TEXT = f"{INJURY_INVERSION[0]:g} ± {INJURY_INVERSION[1]:g}"
INJURY_MOMENT_TEXT = f"{INJURY_MOMENT[0]:g} ... {INJURY_MOMENT[1]:g}"

# How deep the foot starts inside the platform in the paper's records, which the initial pose `published` repeats [mm]:
# in the reference posture on level ground and on the 30° slope; over talocrural angles of -24 ... -44 deg.
DEPTH, DEPTHS = (28, 35), (8, 58)
DEPTH_TEXT = (
    f"{DEPTH[0]} mm (level) to {DEPTH[1]} mm (30° slope) inside the platform in the reference posture, {DEPTHS[0]} to "
    f"{DEPTHS[1]} mm over the postures of the studies"
)

# Largest vertical ground reaction of the means of the paper's six studies, from either initial pose, after the first
# 5 ms; the paper's own model gives the same in OpenSim 4.6.
GROUND_TEXT = "7 to 13 kN, 10 to 19 body weights"

# Li, Ko, Zhang, Brown & Simpson 2018, "Biomechanics of ankle giving way", J. Sport Health Sci.: two people landing on a
# plate tilted by 25 deg. Peak inversion [deg] of landings without injury, for which no velocity is stated; peak
# inversion [deg] and peak inversion velocity [deg/s] of the trials that ended in a sprain. The laboratory's own zero.
LI_SAFE, LI_SPRAIN, LI_SPRAIN_VELOCITY = (35.0, 43.0), 55.0, (600.0, 900.0)
LI_SOURCE = "Li et al. 2018, 25° slope"

# How strong braces are: thirteen commercial orthoses of carbon have 0.58 ... 3.66 N·m/deg in the sagittal plane, up to
# 0.71 in the frontal one [N·m/rad]. Shuman & Russell Esposito 2022, J. Biomech. Eng. 144:011004, doi 10.1115/1.4051845.
ORTHOSES, ORTHOSES_SOURCE = (33.0, 210.0), "Shuman & Russell Esposito 2022"
# What is no brace any more: assumptions of this project, not measured. Softest: a little more than the stiffest of them
# where its degrees are taken for radians [N·m/rad]; least: what that gives at the 50 deg of a landing on the 30° slope
# [N·m]; stiffest: four times the stiffest [N·m/rad]; largest: about what that gives at 45 deg [N·m], nearly ten times
# the largest moment of the 240 % brace of Yoder et al. 2021 in a landing. Too weak is what lies below both.
BRACE_TORQUE, BRACE_STIFFNESS = (3.5, 600.0), (4.0, 800.0)
BRACES_TEXT = (
    f"assumed of braces: {BRACE_TORQUE[0]:g} to {BRACE_TORQUE[1]:g} N.m in a landing, {BRACE_STIFFNESS[0]:g} to "
    f"{BRACE_STIFFNESS[1]:g} N.m/rad; measured orthoses have {ORTHOSES[0]:g} to {ORTHOSES[1]:g} N.m/rad "
    f"({ORTHOSES_SOURCE})"
)
