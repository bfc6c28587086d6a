"""What a run tells about each accepted step."""

import csv
from dataclasses import astuple, dataclass, fields


@dataclass(frozen=True)
class HistoryRow:
    """One accepted step; row 0 is the start.

    On several nested meshes every level begins with a row of its own: its start, with the number
    of the last step before it.

    Parameters
    ----------
    iteration : int
        Accepted steps so far, on all levels.
    level : int
        The mesh, from 1, the coarsest.
    compliance_J, ginzburg_landau_J, objective_J : float [J]
        F, gamma E and their sum J.
    volume_fraction : float
    tau : float
        Step size; of a variable metric D the mean |Omega| / trace(D).
    rejected : int
        Trials before the step was accepted.
    pdas_iterations : int
        Linear systems solved for the quadratic programmes of the step, rejected ones included.
    state_iterations : int
        Iterations of the state solver, rejected trials included.
    kkt_residual, kkt_stationarity, kkt_complementarity, kkt_sign, volume_error : float
        See `topopt.kkt.KKT`.
    seconds : float
        Wall time since the start.
    """

    iteration: int
    level: int
    compliance_J: float
    ginzburg_landau_J: float
    objective_J: float
    volume_fraction: float
    tau: float
    rejected: int
    pdas_iterations: int
    state_iterations: int
    kkt_residual: float
    kkt_stationarity: float
    kkt_complementarity: float
    kkt_sign: float
    volume_error: float
    seconds: float


COLUMNS = tuple(field.name for field in fields(HistoryRow))


def write_history(path, history):
    """Write rows as CSV; floats in full precision."""
    with open(path, "w", newline="", encoding="ascii") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(astuple(row) for row in history)


def read_history(path):
    """Read what `write_history` wrote: tuple of HistoryRow."""
    kinds = {field.name: field.type for field in fields(HistoryRow)}
    with open(path, newline="", encoding="ascii") as stream:
        return tuple(
            HistoryRow(**{name: kinds[name](value) for name, value in row.items()})
            for row in csv.DictReader(stream)
        )
