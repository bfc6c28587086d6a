"""A small case in YAML, for the tests."""

TINY = """\
name: tiny
domain:
  box: {lower: [0, 0, 0], upper: [20mm, 10mm, 10mm]}
symmetry: [x=0, y=0]
supports:
  foot:
    plane: z=0
    x: [16mm, 20mm]
    fixed: [x, y, z]
loads:
  deck:
    plane: z=10mm
    x: [0, 6mm]
    traction: [0, 0, -2400]
mesh: {kind: bcc, tets: 1500}
topopt:
  volume_fraction: 0.4
  gamma: 1.0e-4
  eps: 2mm
  steps: 5
remesh: {vertices: 400, iterations: 2}
presets:
  coarse:
    mesh: {tets: 300}
  long:
    topopt: {steps: 7}
"""


def write_case(folder, text=TINY, name="tiny.yaml"):
    """Write a case file into the folder and return its path."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path
