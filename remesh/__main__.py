"""`python -m remesh IN OUT`: forwards to the command in cases, which alone knows every stage."""

if __name__ == "__main__":
    from cases.entry import start

    raise SystemExit(start("cases.remesh_command", "main"))
