"""A command with folders on small disks, in a mount namespace of its own:
`python small_disk.py '{"full": {"kB": 300, "free": 8}}' COMMAND …`.

Run it by `unshare -Urm`. Each of the named folders becomes a disk (tmpfs) of so many kB, of which so many are free.
Prints as JSON how the command ended, and all files on the disks and around.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path


def main() -> int:
    disks, command = json.loads(sys.argv[1]), sys.argv[2:]
    for name, disk in disks.items():
        folder = Path(name)
        before = {p.name: p.read_bytes() for p in folder.iterdir()} if folder.is_dir() else {}
        folder.mkdir(parents=True, exist_ok=True)
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={disk['kB']}k", "none", name], check=True)
        for file, data in before.items():
            (folder / file).write_bytes(data)
        fill(folder, disk["free"])
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    files = {
        str(p): p.read_bytes().decode("latin-1") for p in Path(".").rglob("*") if p.is_file() and p.name != "filler"
    }
    print(json.dumps({"code": done.returncode, "out": done.stdout, "err": done.stderr, "files": files}))
    return 0


def fill(folder: Path, free: int) -> None:
    """Leave so many kB."""
    room = os.statvfs(folder)
    with open(folder / "filler", "wb") as file:
        file.write(b"\0" * max(0, room.f_bavail * room.f_bsize - free * 1024))


if __name__ == "__main__":
    sys.exit(main())
