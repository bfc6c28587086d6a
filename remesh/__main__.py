"""`python -m remesh IN OUT`: forwards to the command in cases, which alone knows every stage."""

import sys

if __name__ == "__main__":
    try:
        from cases.remesh_command import main
    except KeyboardInterrupt:
        print("error: interrupted", file=sys.stderr)
        raise SystemExit(130) from None
    raise SystemExit(main())
