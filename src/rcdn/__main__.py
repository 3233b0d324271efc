"""`python -m rcdn` is `rcdn`."""

from rcdn.cli import main

if __name__ == "__main__":
    main()
