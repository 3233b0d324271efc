"""Where a run was made: the commit of this code, and the machine."""

from __future__ import annotations

import platform
import subprocess
from pathlib import Path

import torch


def commit() -> str:
    """Commit of the repository that tracks this file; `unknown` for an installed copy, even inside a repository."""
    here = Path(__file__)
    try:
        _git("ls-files", "--error-unmatch", here.name)
        return _git("rev-parse", "HEAD")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def _git(*arguments: str) -> str:
    folder = Path(__file__).parent
    return subprocess.run(["git", *arguments], cwd=folder, capture_output=True, text=True, check=True).stdout.strip()


def machine() -> str:
    """Processor, system, torch, and the GPU if there is one."""
    gpu = f", {torch.cuda.get_device_name()}" if torch.cuda.is_available() else ""
    return f"{platform.machine()} {platform.system()}, torch {torch.__version__}{gpu}"
