"""`python -m remesh IN OUT`: forwards to the command in cases, which alone knows every stage."""

from cases.remesh_command import main

if __name__ == "__main__":
    raise SystemExit(main())
