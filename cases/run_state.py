"""What the stages of a run make, and what they share."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cases.load import LoadedCase
from cases.progress import Reporter
from meshes import PhaseField, TetMesh, TriMesh
from topopt.problem import Problem


@dataclass
class Run:
    """One run: the case, where it writes, and what has been made so far.

    Parameters
    ----------
    loaded : LoadedCase
    problem : Problem
    folder : Path
    reporter : Reporter
    mesh : TetMesh
        Of the last level.
    coarse_meshes : tuple of TetMesh
        Of the levels before it.
    design : PhaseField
    fields : dict of str to array
        Displacement, energy density and stress of the final design.
    modelled : TriMesh
        The isosurface of the modelled part, open on the symmetry planes.
    isosurface, smoothed, surface : TriMesh
        Of the whole part.
    figures : dict of str to dict
        Numbers by stage, for manifest and summary.
    resume : bool
        Whether the optimisation goes on from its last checkpoint.
    """

    loaded: LoadedCase
    problem: Problem
    folder: Path
    reporter: Reporter
    mesh: TetMesh | None = None
    coarse_meshes: tuple[TetMesh, ...] = ()
    design: PhaseField | None = None
    fields: dict[str, np.ndarray] = field(default_factory=dict)
    modelled: TriMesh | None = None
    isosurface: TriMesh | None = None
    smoothed: TriMesh | None = None
    surface: TriMesh | None = None
    figures: dict[str, dict] = field(default_factory=dict)
    resume: bool = False

    @property
    def case(self):
        """The validated case."""
        return self.loaded.case

    @property
    def copies(self):
        """How often the modelled part occurs in the whole one."""
        return 2 ** len(self.problem.symmetry)
