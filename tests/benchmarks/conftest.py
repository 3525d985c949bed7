from tests.rasterisers.conftest import (  # noqa: F401
    _open_rasterisers,
    llvmpipe,
    on_device,
    opened,
    reference,
)
