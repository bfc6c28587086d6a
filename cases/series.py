"""fields/: snapshots of the phase field for ParaView, as one series."""

from pathlib import Path

import numpy as np

from meshes.io import write_series, write_tets


class FieldSeries:
    """Writes fields/step_*.vtu and fields/design.pvd; a kill leaves a series that opens.

    Parameters
    ----------
    folder : Path
    mesh : TetMesh
    earlier : int
        Snapshots of steps up to this one, which are on disk, stay in the series; later ones are
        removed.
    """

    def __init__(self, folder, mesh, earlier=-1):
        self._folder = Path(folder)
        self._mesh = mesh
        self._files, self._times = [], []
        for path in sorted(self._folder.glob("step_*.vtu")):
            step = int(path.stem.removeprefix("step_"))
            if step > earlier:
                path.unlink()
            else:
                self._files.append(path)
                self._times.append(step)

    def write(self, step, point_data, cell_data):
        """Add the fields of a step: nodal and tetrahedral values by name."""
        path = self._folder / f"step_{step:04d}.vtu"
        if path in self._files:
            self._times.pop(self._files.index(path))
            self._files.remove(path)
        write_tets(path, self._mesh, point_data, cell_data)
        self._files.append(path)
        self._times.append(step)
        write_series(self._folder / "design.pvd", self._files, self._times)


def snapshot_steps(count, steps):
    """The steps, at most `count`, at which a run of `steps` steps writes its field.

    They lie close together at first, where most happens: a geometric series that ends before
    the last step.
    """
    if count == 0 or steps < 1:
        return frozenset()
    exponents = np.arange(count) / count
    return frozenset(round(steps**exponent) for exponent in exponents) - {steps}
