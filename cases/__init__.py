"""Cases: a load case in YAML, its stages one after the other, and the files of a run."""
