"""`python -m rcdn`, and the `rcdn` command: what must be there before the imports that take long."""

import sys

from rcdn import interrupts


def main() -> None:
    """The entry point of the `rcdn` command."""
    try:
        interrupts.install()
        from rcdn.cli import main as run

        run()
    except KeyboardInterrupt:  # as `rcdn.cli` says it, which may not be there yet
        interrupts.end()
        if sys.stderr is not None:
            sys.stderr.write("error: stopped by Ctrl-C\n")
        sys.exit(130)


if __name__ == "__main__":
    main()
