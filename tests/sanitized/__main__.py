"""`python -m tests.sanitized`: the kernels under address and undefined-behaviour sanitizers. See CONTRIBUTING.md."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from contextlib import ExitStack

from tests.sanitized.battery import BASELINE, PARTS
from tests.sanitized.build import BUILD, COMPILER, ROOT, library, runtime


def main() -> int:
    """Exit code: 0 if there is no finding (or no sanitizer, which is said), 1 if there is one."""
    preload = runtime()
    if preload is None:
        print(f"skipped: {COMPILER} has no sanitizers (libasan, libubsan); install gcc, or name another compiler in CC")
        return 0
    began = time.monotonic()
    built = library()
    print(f"built {built} in {time.monotonic() - began:.0f} s", flush=True)
    environment = os.environ | {
        "LD_PRELOAD": " ".join(map(str, preload)),
        "ASAN_OPTIONS": "detect_leaks=0:allocator_may_return_null=1:detect_stack_use_after_return=1",
        "UBSAN_OPTIONS": "print_stacktrace=0",
        "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT / "lab/src"), str(ROOT)]),
        "PYTHONMALLOC": "malloc",
    }
    baseline = {"RCDN_LEVEL": "baseline"}
    outputs = [BUILD / f"said-{part}.txt" for part in PARTS]
    with ExitStack() as stack:
        running = [
            subprocess.Popen(
                [sys.executable, "-m", "tests.sanitized.battery", str(built), part],
                env=environment | (baseline if part in BASELINE else {}), cwd=ROOT,
                stderr=stack.enter_context(output.open("wb")),
            )
            for part, output in zip(PARTS, outputs, strict=True)
        ]  # fmt: skip
        codes = [process.wait() for process in running]
    text = "".join(output.read_text(errors="replace") for output in outputs)
    found = {line for line in text.splitlines() if "runtime error: " in line or "ERROR: AddressSanitizer" in line}
    places = {line.split(" runtime error")[0] for line in found}
    if found or any(codes):
        print(text[-20_000:])
    print(
        f"{len(places)} findings in {time.monotonic() - began:.0f} s"
        + (f"; the parts ended with {codes}" if any(codes) else "")
    )
    return int(bool(found) or any(codes))


if __name__ == "__main__":
    sys.exit(main())
