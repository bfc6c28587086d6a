"""The bridge of the thesis: `python -m cases.bridge`."""

from pathlib import Path

from cases.entry import start

CASE = Path(__file__).with_suffix(".yaml")


def main(arguments=None):
    """Run the case with command-line arguments; returns the exit code."""
    return start("cases.cli", "run_bundled", CASE, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
