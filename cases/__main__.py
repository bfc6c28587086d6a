"""`python -m cases FILE.yaml`."""

from cases.entry import start


def main(arguments=None):
    """Run the case file named by the command-line arguments; returns the exit code."""
    return start("cases.cli", "main", arguments)


if __name__ == "__main__":
    raise SystemExit(main())
