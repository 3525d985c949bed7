from tests.rasterisers.conftest import _open_rasterisers, llvmpipe, opened, reference  # noqa: F401
