"""The errors of the package: every one is a sentence a user can act on."""


class InvalidCase(ValueError):
    """A case, option or argument that cannot be run; says what, where and what to change."""


class InvalidMesh(ValueError):
    """A mesh that breaks a precondition (open, inverted, non-manifold ...)."""


class NotConverged(RuntimeError):
    """An iteration that stalled.

    Parameters
    ----------
    message : str
        What stalled, where, and what to change.
    history : sequence of float, optional
        Residuals (or whatever the iteration measures), oldest first.
    """

    def __init__(self, message, history=()):
        super().__init__(message)
        self.history = tuple(history)
