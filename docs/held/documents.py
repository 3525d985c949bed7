"""Which document cites which figures: those that people read, and what `study all` sets beside."""

from docs.held import Held, claims, findings, flips, others, readme, simulated

DOCUMENTS: dict[str, tuple[list[Held], tuple[str, ...]]] = {
    "README.md": (readme.HELD, readme.DEFINITIONS),
    "docs/how-to/ci.md": (others.GATE, others.GATE_RULES),
    "docs/findings.md": (findings.FIRST, findings.DEFINITIONS),
    "docs/findings-tables.md": (findings.TABLES, findings.DEFINITIONS),
    "docs/flips.md": (flips.HELD, flips.DEFINITIONS),
    "docs/studies/skybox.md": (simulated.HELD, simulated.DEFINITIONS),
    "docs/studies/whole-gpu.md": (simulated.WHOLE_HELD, simulated.WHOLE_DEFINITIONS),
    "harness/study/replication.py": (claims.HELD, claims.DEFINITIONS),
    "docs/upstream.md": (flips.UPSTREAM, flips.TOLD),
}
"""For each document what is held, and patterns of numbers that nobody measured."""
