"""Which document cites which figures."""

from docs.held import Held, claims, findings, flips, others, readme, simulated

DOCUMENTS: dict[str, tuple[list[Held], tuple[str, ...]]] = {
    "README.md": (readme.HELD, readme.DEFINITIONS),
    "docs/ci/README.md": (others.GATE, others.GATE_RULES),
    "docs/findings.md": (findings.FIRST, findings.DEFINITIONS),
    "docs/findings-tables.md": (findings.TABLES, findings.DEFINITIONS),
    "docs/flips.md": (flips.HELD, flips.DEFINITIONS),
    "docs/optimum-on-a-gpu.md": (others.GPU, others.GPU_DESIGN),
    "docs/studies/skybox.md": (simulated.HELD, simulated.DEFINITIONS),
    "docs/theory.md": ([], others.THEOREMS),
    "harness/study/our_figures.py": (claims.HELD, claims.DEFINITIONS),
}
"""For each document what is held, and patterns of numbers that nobody measured."""

COMMON = r"\b95 %|1/256 px|\b2x2\b|\b4x4\b|\(m, 3\)|(?m:^(## )?\d\. )|[Ee]xit code \d|4Q - S"

CHOSEN = {
    "docs/architecture.md": "",
    "docs/index.md": r"0 for a correct|60 degrees|24 bytes",
    "docs/reading-the-report.md": r"Below 1 is|one side of 1",
    "docs/tutorial.md": "",
    "docs/how-to/add-a-rasteriser.md": "",
    "docs/how-to/add-a-scene.md": "",
    "docs/how-to/add-a-triangulator.md": "",
    "docs/how-to/ci.md": r"with 1 if something|1\.5 %|0\.1 %|threshold of 5 %",
    "docs/how-to/command-line.md": r"\| \d+ \|",
    "docs/how-to/contribute-a-device.md": r"from \d+|145 on Macs|0\.1 ms",
    "docs/how-to/devices.md": r"Direct3D 12|1/16 px",
    "docs/how-to/judge-criteria.md": r"fewer than 100 triang|at least 0\.8",
    "docs/how-to/meshes.md": "",
    "docs/how-to/models.md": r"(from|of) 24 sides|of up to 192 vertices|from 1 to 24|multiples of 4|\| (1024|3) \||from 1\.1 on"
    r"|\(1, 2, 3\)",
    "docs/how-to/own-criterion.md": r"up to 2,000 vertices",
    "docs/how-to/own-polygons.md": r"-180 to 180 degrees|3D model|1 GiB|100 times",
    "docs/how-to/profile.md": "",
    "docs/how-to/put-it-in-your-program.md": r"Node\.js 18",
    "docs/how-to/tiles.md": r"256, 512, 1024 for|\| (16|512) \||4096 on 512 px|1/8 px"
    r"|extent of 5000",
}
"""Pages that cite no result, with patterns of the sizes, limits and versions that they name."""

DOCUMENTS |= {page: ([], (COMMON, pattern)) for page, pattern in CHOSEN.items()}
