"""The plant as a device: its functions move values between the FMU's variables and the kernels' state."""

from . import kernels, person
from .interface import ANKLE_MUSCLES, AXES, FIBRE_STARTS, LOCALS, MOVING, OUTPUTS, PERSON, PLACED, POSES, variables

NAMES = [v["name"] for v in variables()]
GROUPS = {
    "placed": list(PLACED.values()),
    "moving": list(MOVING.values()),
    "inputs": NAMES[NAMES.index(f"{ANKLE_MUSCLES[0]}_excitation") : NAMES.index(OUTPUTS[0])],
    "outputs": OUTPUTS,
    "moments": [f"brace_{axis}_moment" for axis in AXES],
    "hidden": [name for name, _, _ in LOCALS],
    "person": [row[0] for row in PERSON],
}
# besides, the constants of a person who is not the base person
STATE = kernels.in_whole_vectors(
    [(name, kernels.STATE[name].base, kernels.STATE[name].shape) for name in kernels.STATE.names]
    + [
        ("model", kernels.MODEL),
        ("facets", person.SOLE["facets"].base, person.SOLE["facets"].shape),
        ("blocks", person.SOLE["blocks"].base, person.SOLE["blocks"].shape),
        ("scaled", person.SCALED),
    ]
)
SAVED_BEFORE = kernels.SAVED_BEFORE
EXPERIMENT = {"step": 0.0005, "steps": 20}  # what plain Python computes in seconds
AS_PUBLISHED, PUBLISHED = FIBRE_STARTS["as_published"], POSES["published"]
REASONS = (
    "",
    "the integration stopped at {time:.6f} s: the state is no longer finite",
    "the integration stopped at {time:.6f} s: the step fell below 1e-11 s",
    f"the integration stopped at {{time:.6f}} s: {kernels.MAX_STEPS} steps were not enough; the parameters make the "
    "model too stiff",
    "initial_pose = given: the foot is {depth_mm:.1f} mm inside the platform; raise pelvis_ty_at_contact, or let "
    "initial_pose = touching find the height",
    "no part of the sole is on this side of the platform's edge; make platform_edge_distance larger",
    "initial_pose = published is a height measured on the base person, which leaves another one's foot far above or "
    "inside the platform; with length factors other than 1 choose initial_pose = touching",
)
OTHER_PERSON = len(REASONS) - 1


def constants(resources):
    """The base person's (person.BASE)."""
    from . import constants as tables

    return tables.record()


def initialise(values, state, constants, time):
    if values.initial_pose == PUBLISHED and not person.has_base_lengths(values.person):
        return OTHER_PERSON
    embody(values, state, constants)
    if state.scaled.own == 1:
        return start(values, state, state.model, state.facets, state.blocks, time)
    return start(values, state, constants.model, constants.sole.facets, constants.sole.blocks, time)


def embody(values, state, constants):
    person.embody(
        constants, constants.sole, state.model, state, state.scaled, state.facets, state.blocks, values.person
    )


def start(values, state, model, facets, blocks, time):
    kernels.take(state, values.inputs)  # the excitations give the first activations
    kernels.prepare(model, state, values)
    as_published = values.fibre_start == AS_PUBLISHED
    status = kernels.initialise(model, state, facets, blocks, values.initial_pose, as_published)
    state.time = time
    if status == kernels.DONE:
        kernels.respond(model, state, values.inputs, values.moments)
        kernels.observe(model, state, facets, blocks, values.outputs)
    return status


def step(values, state, constants, time, step):
    if state.scaled.own == 1:
        return advance(values, state, state.model, state.facets, state.blocks, time + step)
    return advance(values, state, constants.model, constants.sole.facets, constants.sole.blocks, time + step)


def advance(values, state, model, facets, blocks, end):
    kernels.take(state, values.inputs)
    status = kernels.advance(model, state, facets, blocks, end, 0.0)
    if status == kernels.DONE:
        kernels.observe(model, state, facets, blocks, values.outputs)
    return status


def refresh(values, state, constants):
    model = state.model if state.scaled.own == 1 else constants.model
    kernels.respond(model, state, values.inputs, values.moments)


def reveal(values, state, constants):
    if state.scaled.own == 1:
        kernels.look(state.model, state, state.facets, state.blocks, values.hidden)
    else:
        kernels.look(constants.model, state, constants.sole.facets, constants.sole.blocks, values.hidden)


def restored(values, state, constants):
    embody(values, state, constants)
