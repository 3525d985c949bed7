"""Ask WebGPU what it can open: run as a program, in the environment of the device looked for.

`python webgpu_probe.py BACKEND,BACKEND` (Vulkan, Metal, DX12, GL) opens nothing but the drivers'
lists and prints one JSON object. It stands alone, as `probe.py` does and for the same reasons.
"""

from __future__ import annotations

import json
import sys
from typing import Any

TOLD = ("vendor", "architecture", "device", "description", "adapter_type", "backend_type")


def main(backends: list[str]) -> dict[str, Any]:
    """List the adapters of some backends; {"devices": [...], "problems": [...]}."""
    try:
        import wgpu
        from wgpu.backends.wgpu_native.extras import set_instance_extras

        set_instance_extras(backends=backends)
        adapters = wgpu.gpu.enumerate_adapters_sync()
    except (ImportError, OSError, RuntimeError) as error:
        return {"devices": [], "problems": [str(error)]}
    return {
        "devices": [{name: str(adapter.info[name]) for name in TOLD} for adapter in adapters],
        "problems": [],
    }


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1].split(","))))
