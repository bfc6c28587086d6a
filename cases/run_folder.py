"""The folder of a run: which files belong to it, and whose they are."""

import json
from pathlib import Path

from cases.resolved import read_case
from meshes.errors import InvalidCase

STAGES = ("mesh", "topopt", "isosurface", "smooth", "remesh")
OUTPUT = "output"  # quality, pictures and summary, after the last stage

# What each stage writes; the first is what a later stage goes on from.
_FILES = {
    "mesh": ("mesh.npz", "mesh-level*.npz"),
    "topopt": (
        "phase_field.npz",
        "history.csv",
        "checkpoint-*.npz",
        "fields/*.vtu",
        "fields/*.pvd",
    ),
    "isosurface": ("isosurface.ply",),
    "smooth": ("smoothed.ply",),
    "remesh": ("surface.ply", "surface.stl"),
}
_ALWAYS = ("quality.json", "summary.txt", "pictures/*.png")
_RUN_FILES = ("manifest.json", "run.log")

# The sections of the case on which the files of a stage depend, besides the earlier stages'.
_SECTIONS = {
    "mesh": ("name", "domain", "symmetry", "supports", "loads", "mesh"),
    "topopt": ("material", "gravity", "topopt"),
    "isosurface": ("isosurface",),
    "smooth": ("smooth",),
    "remesh": ("seed", "rbf", "remesh"),
}


# What --resume goes on with: these stay, and are read.
_RESUMED = ("checkpoint-*.npz", "fields/*.vtu", "fields/*.pvd", "history.csv")

# What only says when the optimisation ends; its steps do not depend on it.
_ENDS = ("steps", "tolerance", "stagnation")


def topopt_sections(case):
    """The parts of a resolved case on which a step of the optimisation depends."""
    names = [name for stage in STAGES[:2] for name in _SECTIONS[stage]]
    sections = {name: case.get(name) for name in names}
    topopt = {key: value for key, value in case["topopt"].items() if key not in _ENDS}
    return {**sections, "topopt": topopt}


class RunFolder:
    """The output folder of one run.

    Parameters
    ----------
    path : str or Path
    """

    def __init__(self, path):
        self.path = Path(path)

    def __truediv__(self, name):
        return self.path / name

    def prepare(self, case, first_stage, force, resume=False):
        """Check that the folder may be written to, and make it ready.

        Parameters
        ----------
        case : dict
            The resolved case.
        first_stage : str
            The files of this stage and of later ones are removed, those before it are kept.
        force : bool
            Whether another run's files may be removed.
        resume : bool
            Whether the optimisation's unfinished files are kept, to be gone on with.

        Raises
        ------
        InvalidCase
            If the folder holds another run's files, or lacks the stages before `first_stage`.
        """
        if first_stage != STAGES[0]:
            self._check_reusable(case, first_stage)
        elif not force:
            self._check_mine(case)
        kept = {file for pattern in _RESUMED for file in self.path.glob(pattern) if resume}
        try:
            for name in ("", "fields", "pictures"):
                (self.path / name).mkdir(parents=True, exist_ok=True)
            for file in set(self._files_from(first_stage)) - kept:
                file.unlink(missing_ok=True)
        except OSError as error:
            raise InvalidCase(f"--out {self.path}: {error.strerror}") from None

    def _files_from(self, stage):
        patterns = [*_ALWAYS]
        for name in STAGES[STAGES.index(stage) :]:
            patterns += _FILES[name]
        if stage == STAGES[0]:
            patterns += _RUN_FILES
        return [file for pattern in patterns for file in self.path.glob(pattern)]

    def _products(self):
        """Whether the folder has any file that a stage made."""
        patterns = [pattern for stage in STAGES for pattern in _FILES[stage]]
        return any(True for pattern in patterns for _ in self.path.glob(pattern))

    def _check_mine(self, case):
        if not self.path.exists():
            return
        if not self.path.is_dir():
            raise InvalidCase(f"--out {self.path}: is a file, not a folder")
        if self._products() and self.stored_case() != case:
            raise InvalidCase(
                f"--out {self.path}: holds another run's files; choose another folder, "
                "or add --force to replace them"
            )

    def stored_case(self):
        """The resolved case that the folder's files were made by, or None."""
        return read_case(self.path / "case.yaml")

    def unfinished_stage(self, case, last):
        """The stage at which an earlier run of the same case goes on; None if it is finished.

        Parameters
        ----------
        case : dict
            The resolved case. It may end the optimisation later or earlier than the stored one.
        last : str
            The last stage asked for.

        Raises
        ------
        InvalidCase
            If the folder holds no run, or one of another case.
        """
        stored = self.stored_case()
        if stored is None:
            raise InvalidCase(
                f"--resume: {self.path} holds no earlier run (case.yaml is missing); "
                "run without --resume"
            )
        self._check_same(case, stored)
        done = stages_done(self.path / "manifest.json")
        for stage in STAGES[: STAGES.index(last) + 1]:
            ended_otherwise = stage == "topopt" and case["topopt"] != stored["topopt"]
            product = self.path / _FILES[stage][0]
            if stage not in done or ended_otherwise or not product.is_file():
                return stage
        return None if OUTPUT in done else last

    def _check_same(self, case, stored):
        """Refuse to go on with another case; when the optimisation ends may differ."""
        new, old = ({**tree, **topopt_sections(tree), "output": None} for tree in (case, stored))
        difference = _first_difference(new, old, "")
        if difference:
            key, now, before = difference
            raise InvalidCase(
                f"--resume: {key.removeprefix('.')} is {now} now and was {before} when the run "
                "was started; resume with the same --preset and --set, or use --from STAGE"
            )

    def _check_reusable(self, case, first_stage):
        stored = self.stored_case()
        if stored is None:
            raise InvalidCase(
                f"--from {first_stage}: {self.path} holds no earlier run of this case "
                "(case.yaml is missing); run without --from first"
            )
        earlier = STAGES[: STAGES.index(first_stage)]
        for stage in earlier:
            for section in _SECTIONS[stage]:
                _check_unchanged(case, stored, section, stage, first_stage)
        for stage in earlier:
            if not (self.path / _FILES[stage][0]).is_file():
                raise InvalidCase(
                    f"--from {first_stage}: {self.path / _FILES[stage][0]} is missing; "
                    f"run with --from {stage} or without --from"
                )


def stages_done(manifest):
    """The records of what the run of a manifest.json finished, "output" included: dict by name."""
    try:
        stages = json.loads(manifest.read_text(encoding="utf-8"))["stages"]
        return {name: stages[name] for name in (*STAGES, OUTPUT) if name in stages}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _check_unchanged(case, stored, section, stage, first_stage):
    difference = _first_difference(case.get(section), stored.get(section), section)
    if difference:
        key, new, old = difference
        advice = "without --from" if stage == STAGES[0] else f"with --from {stage}"
        raise InvalidCase(
            f"--from {first_stage}: {key} is {new} now and was {old} when the files were made, "
            f"which changes the stage {stage}; run {advice}, or with the same --preset and --set"
        )


def _first_difference(new, old, key):
    """The first (dotted key, new, old) at which two trees differ, or None."""
    if isinstance(new, dict) and isinstance(old, dict):
        for name in [*new, *(name for name in old if name not in new)]:
            found = _first_difference(new.get(name), old.get(name), f"{key}.{name}")
            if found:
                return found
        return None
    return None if new == old else (key, new, old)
