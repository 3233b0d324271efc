"""Description of the machine on which a run was trained."""

from __future__ import annotations

import platform

import torch


def machine() -> str:
    """Processor, system, torch, and the GPU if there is one."""
    gpu = f", {torch.cuda.get_device_name()}" if torch.cuda.is_available() else ""
    return f"{platform.machine()} {platform.system()}, torch {torch.__version__}{gpu}"
