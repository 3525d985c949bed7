"""Imports of the worker server in tests, which start about two hundred workers.

They include the modules that a run loads in its second process and those that its workers import
late, because otherwise each worker would load them again.
"""

import gc
from contextlib import suppress

import scipy.special  # noqa: F401 - for the workers
from shapely import box

from harness.frame import View, make_frame
from harness.machine import system
from harness.measuring.tasks import compute_min_quads
from harness.rasterisers.reference import count_outline_quads
from triangulators import triangulate_many
from triangulators.compute.storing import NotCompiledError, forbid_compiling

system.read_steal_time_s = system.read_other_processes_s = lambda: 0.0  # as in `tests.conftest`

with suppress(NotCompiledError), forbid_compiling():
    frame = make_frame([box(0, 0, 4, 4), box(0, 0, 8, 8) - box(2, 2, 4, 4)], View(16))
    count_outline_quads(frame, triangulate_many(frame.polygons))
    compute_min_quads(frame, None)

gc.freeze()
