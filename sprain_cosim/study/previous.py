"""What version 0.1 wrote into ledgers and manifests, in today's form.

Its identity named three settings of the master, and not the order of the inputs; its ledgers describe the whole study
besides, so that today's identity can be made of them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from .codec import decode
from .identity import DRAWING, digest_of, identity
from .methods import SEARCHES
from .plan import Plan


def is_previous(then: Mapping[str, Any]) -> bool:
    """Whether an identity is in the form of version 0.1."""
    return isinstance(then.get("master"), list)


def facts_today(facts: Mapping[str, str]) -> dict[str, str]:
    """The facts of a ledger with identity and digest in today's form: of the study that the ledger describes, with the
    version and the file contents that its identity names. Unchanged where there is no description."""
    then = json.loads(facts.get("identity", "{}"))
    study = decode(json.loads(facts.get("study", "null"))) if is_previous(then) else None
    if not isinstance(study, Plan):
        return dict(facts)
    files = {kind: then.get(kind, {}) for kind in ("fmus", "maps")}
    now = identity(study, files) | {"version": then["version"]}
    now["order"].pop(DRAWING, None)  # columns were drawn in the file's order
    return {**facts, "identity": json.dumps(now, sort_keys=True), "digest": digest_of(now)}


def identity_then(study: Plan) -> dict[str, Any]:
    """The identity of a study in the form of version 0.1, without versions and files: what its manifests are compared
    with when there is no ledger."""
    scenario = study.scenario
    search = (*study.levels, repr(study.threshold), study.space, study.step, study.difference, study.settling)
    table = None if study.table is None else study.table.tobytes() + repr(study.numbers).encode()
    return {
        "parameters": dict(scenario.parameters),
        "connections": dict(scenario.connections),
        "master": [scenario.master.communication_step, scenario.master.stop, scenario.master.scheme],
        "marginals": {name: repr(marginal) for name, marginal in study.marginals.items()},
        "correlation": None if study.correlation is None else study.correlation.tolist(),
        "grid": {name: list(levels) for name, levels in study.grid.items()},
        "method": study.method,
        "seed": study.seed,
        "trials": study.trials if study.method in ("lhs", "sobol-indices") else None,
        "replicates": study.sequences if study.method in ("sobol", "sobol-indices") else None,
        "search": [*search, study.budget, study.responses[0]] if study.method in SEARCHES else None,
        "table": None if table is None else hashlib.sha256(table).hexdigest(),
    }
