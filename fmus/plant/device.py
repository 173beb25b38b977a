"""The plant as a device: its functions move values between the FMU's variables and the kernels' state."""

from . import kernels
from .interface import ANKLE_MUSCLES, AXES, FIBRE_STARTS, LOCALS, MOVING, OUTPUTS, PLACED, variables

NAMES = [v["name"] for v in variables()]
GROUPS = {
    "placed": list(PLACED.values()),
    "moving": list(MOVING.values()),
    "inputs": NAMES[NAMES.index(f"{ANKLE_MUSCLES[0]}_excitation") : NAMES.index(OUTPUTS[0])],
    "outputs": OUTPUTS,
    "moments": [f"brace_{axis}_moment" for axis in AXES],
    "hidden": [name for name, _, _ in LOCALS],
}
STATE, SAVED_BEFORE = kernels.STATE, kernels.SAVED_BEFORE
EXPERIMENT = {"step": 0.0005, "steps": 20}  # what plain Python computes in seconds
AS_PUBLISHED = FIBRE_STARTS["as_published"]
REASONS = (
    "",
    "the integration stopped at {time:.6f} s: the state is no longer finite",
    "the integration stopped at {time:.6f} s: the step fell below 1e-11 s",
    f"the integration stopped at {{time:.6f}} s: {kernels.MAX_STEPS} steps were not enough; the parameters make the "
    "model too stiff",
    "initial_pose = given: the foot is {depth_mm:.1f} mm inside the platform; raise pelvis_ty_at_contact, or let "
    "initial_pose = touching find the height",
)


def constants(resources):
    """kernels.MODEL, and the sole in blocks (constants.blocks)."""
    from . import constants as tables

    model = tables.record()
    facets, blocks = tables.blocks(tables.sole())
    return {**{name: model[0][name] for name in model.dtype.names or ()}, "facets": facets, "blocks": blocks}


def initialise(values, state, constants, time):
    kernels.take(state, values.inputs)  # the excitations give the first activations
    kernels.prepare(constants, state, values)
    as_published = values.fibre_start == AS_PUBLISHED
    status = kernels.initialise(constants, state, constants.facets, constants.blocks, values.initial_pose, as_published)
    state.time = time
    if status == kernels.DONE:
        kernels.respond(constants, state, values.inputs, values.moments)
        kernels.observe(constants, state, constants.facets, constants.blocks, values.outputs)
    return status


def step(values, state, constants, time, step):
    kernels.take(state, values.inputs)
    status = kernels.advance(constants, state, constants.facets, constants.blocks, time + step, 0.0)
    if status == kernels.DONE:
        kernels.observe(constants, state, constants.facets, constants.blocks, values.outputs)
    return status


def refresh(values, state, constants):
    kernels.respond(constants, state, values.inputs, values.moments)


def reveal(values, state, constants):
    kernels.look(constants, state, constants.facets, constants.blocks, values.hidden)
