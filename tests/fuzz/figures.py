"""What `make fuzz` and the attack on the C target write to results/fuzz.json and results/target_fuzz.json."""

from __future__ import annotations

from tests.front_door.figures import Figures, MayBeEmpty


class Finding(Figures):
    """What a case led to."""

    kind: str
    node: str
    case: int
    target: str
    message: str
    what: str


class Campaign(Figures):
    """One campaign."""

    seed: int
    check_fields: bool
    requests: int
    messages: int
    parameters: int
    seconds: float
    growth: dict[str, float]
    sent: dict[str, int]
    findings: MayBeEmpty[list[Finding]]
    deaths: int
    internal_errors: int
    memory_growth_percent: float


class Fuzz(Figures):
    """Both campaigns."""

    requests: int
    messages: int
    parameters: int
    deaths: int
    internal_errors: int
    memory_growth_percent: float
    seed: int
    seconds: float
    campaigns: list[Campaign]


class TargetFuzz(Figures):
    """The attack on the C target."""

    frames: int
    signed: int
    forged: int
    accepted: int
    currents: int
    states: list[int]
    findings: list[str]
    seed: int
    seconds: float


class Peers(Figures):
    """A stranger's node beside a rig; the names of the attacks that succeeded."""

    attacks: int
    succeeded: int
    names: list[str]


class Pages(Figures):
    """Hostile names on pages; those that did anything."""

    payloads: int
    executed: int
    names: list[str]


class Security(Figures):
    """Files, peers and pages of strangers, in results/security.json."""

    mutants: int
    crafted: int
    tracebacks: int
    crashes: int
    over_limits: int
    escaped: int
    peers: Peers
    pages: Pages | None = None
