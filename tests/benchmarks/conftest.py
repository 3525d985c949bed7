"""Fixtures of the tests, for the benchmarks too."""

from tests.rasterisers.conftest import (  # noqa: F401
    _open_rasterisers,
    llvmpipe,
    native,
    opened,
    reference,
)
