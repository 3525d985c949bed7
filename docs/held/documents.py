"""Which document cites which figures."""

from docs.held import Held, findings, flips, others, readme

DOCUMENTS: dict[str, tuple[list[Held], tuple[str, ...]]] = {
    "README.md": (readme.HELD, readme.DEFINITIONS),
    "docs/ci/README.md": (others.GATE, others.GATE_RULES),
    "docs/findings.md": (findings.HELD, findings.DEFINITIONS),
    "docs/flips.md": (flips.HELD, flips.DEFINITIONS),
    "docs/optimum-on-a-gpu.md": (others.GPU, others.GPU_DESIGN),
    "docs/studies/learned.md": (others.LEARNED, others.LEARNED_PLAN),
}
"""For each document what is held, and patterns of numbers that nobody measured."""
