"""Entry point of `python -m rcdn` and of the `rcdn` command: installs the Ctrl-C handler before the slow imports."""

import sys

from rcdn import interrupts


def main() -> None:
    """The entry point of the `rcdn` command."""
    try:
        interrupts.install()
        from rcdn.cli import main as run

        run()
    except KeyboardInterrupt:  # same message as in `rcdn.cli`, which may not have been imported yet
        interrupts.end()
        if sys.stderr is not None:
            sys.stderr.write("error: stopped by Ctrl-C\n")
        sys.exit(130)


if __name__ == "__main__":
    main()
