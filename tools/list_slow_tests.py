"""Writes tests/slow_tests.txt: the tests that `python -m pytest` leaves out, and `python -m pytest -m slow` runs.

    python -m pytest -n auto --dist loadgroup -m "slow or not slow" --junitxml build/times.xml
    python tools/list_slow_tests.py build/times.xml --seconds 200

The functions that took longest are slow, as many as must be for the others to take so many processor-seconds together.
With --add and the report of `python -m pytest`, they join those that are listed: what a slow test had prepared for
others of its file now counts as theirs.
"""

import argparse
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).parents[1]
LIST = ROOT / "tests" / "slow_tests.txt"
HEAD = """\
# Test functions that `python -m pytest` leaves out and `python -m pytest -m slow` runs, beside those of files that are
# slow as a whole; written by tools/list_slow_tests.py from the times of a whole run.
"""


def times_of(report: Path) -> Counter[str]:
    """Seconds of each test function, all its parameters together, from a JUnit report of pytest."""
    times: Counter[str] = Counter()
    for case in ElementTree.parse(report).iter("testcase"):
        path = ROOT.joinpath(*case.attrib["classname"].split(".")).with_suffix(".py")
        if path.is_file():
            name = case.attrib["name"].split("[")[0].split("@")[0]
            times[f"{path.relative_to(ROOT).as_posix()}::{name}"] += float(case.attrib["time"])
    return times


def slow_of(times: Counter[str], seconds: float) -> list[str]:
    """The slowest functions, without which the others take at most so many seconds."""
    left, slow = sum(times.values()), []
    for test, taken in times.most_common():
        if left <= seconds:
            break
        slow.append(test)
        left -= taken
    return sorted(slow)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("report", type=Path, help="JUnit report of a whole run")
    parser.add_argument("--seconds", type=float, default=200.0, help="of all other tests together, one after another")
    parser.add_argument("--add", action="store_true", help="keep those that are listed")
    given = parser.parse_args()
    times = times_of(given.report)
    slow = set(slow_of(times, given.seconds))
    rest = sum(times.values()) - sum(times[test] for test in slow)
    if given.add:
        slow |= {line for line in LIST.read_text().splitlines() if not line.startswith("#")}
    LIST.write_text(HEAD + "".join(f"{test}\n" for test in sorted(slow)))
    print(f"{len(slow)} test functions are slow; the others took {rest:.0f} s")


if __name__ == "__main__":
    main()
