"""`python -m cases FILE.yaml`."""

from cases.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
