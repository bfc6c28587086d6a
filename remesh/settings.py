"""What can be asked of the remesher."""

from dataclasses import dataclass

from meshes.errors import InvalidCase

ALGORITHMS = ("pliant", "thesis")
QUALITIES = (None, "3d", "6d")


@dataclass(frozen=True)
class ThesisRules:
    """Every rule of the thesis's Algorithm 2 and of the operations in its section 2.4.

    Parameters
    ----------
    collapse_below, split_above : float
        Edges are short below, long above this times the target 6D length.
    inner_limit : int
        Most rounds of collapsing, smoothing and flipping per outer iteration.
    smoothing_fraction : float
        Share of the vertices, drawn at random, that is smoothed in an inner round.
    ridge_angle : float [degrees]
        No flip where the two triangles' normals differ by more.
    alpha : float
        Factor of the Bossen-Heckbert step.
    clip : float
        A step is at most this times the least height of the triangles around.
    least_agreement : float
        Least cosine between a new triangle's normal and the surface's at its corners.
    least_success : float
        An inner loop ends early when a smaller share of its short edges could be collapsed.
    """

    collapse_below: float = 0.5
    split_above: float = 1.5
    inner_limit: int = 10
    smoothing_fraction: float = 0.3
    ridge_angle: float = 60.0
    alpha: float = 0.2
    clip: float = 0.8
    least_agreement: float = 0.3
    least_success: float = 0.01


@dataclass(frozen=True)
class RemeshSettings:
    """How to remesh. One of `vertices`, `edge_length` and `max_error` says how fine.

    Parameters
    ----------
    vertices : int, optional
        Vertices of the result (met within 2 %).
    edge_length : float, optional [unit of the points]
        6D edge length of the result.
    sigma : float [unit of the points]
        Weight of the normals in the embedding (x, sigma n): 0 for equal triangles, more for
        smaller ones where the surface is curved.
    iterations : int
        Rounds of splitting, collapsing, flipping and smoothing.
    algorithm : "pliant" or "thesis"
        The measured recipe, or the thesis's Algorithm 2 as it stands.
    smoothing : int
        Pairs of Taubin smoothing of the carrier, for jagged input; 0 for none. Short edges of the
        carrier are collapsed first. Gaps are still measured to the surfaces given.
    fit : bool
        Fit the triangles (not the vertices) to the surface, and keep the volume.
    optimise : bool
        Search for better angles at the end.
    quality : "3d", "6d" or None
        Whose worst angles the last passes improve, those in space or in the embedding, at the cost
        of time. None: as sigma has it.
    fix_boundary : bool
        Leave open boundaries as they are, bit by bit.
    corner_angle : float [degrees]
        Feature curves are cut at corners where they turn by more.
    max_error : float, optional [unit of the points]
        Instead of `vertices`: as few triangles as keep every point of the result, and every point
        of the surface, within this distance of the other, which is proved. With `edge_length` too
        no edge is longer in the embedding.
    max_normal_angle : float, optional [degrees]
        With `max_error`: every point of either has a point of the other within that distance whose
        normal differs by no more.
    gradation : float, optional
        How many times longer edges may be from one triangle to the next: where edges are h long,
        h grows by no more than gradation - 1 times the way along the surface. (Edges of
        equilateral triangles with the triangles' areas, where sigma stretches them.)
    min_length, max_length : float [unit of the points]
        In 3D: edges below the first are collapsed and never made by splitting, unless features or
        the triangles' shapes forbid it; none are longer than the second.
    least_angle : float [degrees]
        With `max_error`: no smaller angle is made where there was none.
    thesis : ThesisRules
        The rules of algorithm "thesis".

    Raises
    ------
    InvalidCase
        If a value is out of range.
    """

    vertices: int | None = None
    edge_length: float | None = None
    sigma: float = 0.0
    iterations: int = 10
    algorithm: str = "pliant"
    smoothing: int = 0
    fit: bool = True
    optimise: bool = True
    quality: str | None = None
    fix_boundary: bool = False
    corner_angle: float = 45.0
    max_error: float | None = None
    max_normal_angle: float | None = None
    gradation: float | None = None
    min_length: float = 0.0
    max_length: float = float("inf")
    least_angle: float = 1.0
    thesis: ThesisRules = ThesisRules()

    def __post_init__(self):
        if self.vertices is not None and self.edge_length is not None:
            raise InvalidCase("ask for a number of vertices or for an edge length, not for both")
        if self.vertices is not None and not self.vertices >= 4:
            raise InvalidCase(f"vertices must be at least 4, got {self.vertices}")
        if self.edge_length is not None and not 0.0 < self.edge_length < float("inf"):
            raise InvalidCase(f"the edge length must be positive, got {self.edge_length}")
        if not 0.0 <= self.sigma < float("inf"):
            raise InvalidCase(f"sigma must not be negative, got {self.sigma}")
        if self.iterations < 1:
            raise InvalidCase(f"at least one iteration is needed, got {self.iterations}")
        if self.algorithm not in ALGORITHMS:
            raise InvalidCase(f"algorithm must be one of {ALGORITHMS}, got {self.algorithm!r}")
        if self.quality not in QUALITIES:
            raise InvalidCase(f"quality must be 3d, 6d or None, got {self.quality!r}")
        if self.quality is not None and self.algorithm == "thesis":
            raise InvalidCase("the thesis's algorithm knows no quality passes")
        if self.smoothing < 0:
            raise InvalidCase(f"smoothing must not be negative, got {self.smoothing}")
        self._check_sizing()
        self._check_bound()

    @property
    def sized(self):
        """Whether lengths are limited or graded."""
        limited = self.min_length > 0.0 or self.max_length < float("inf")
        return limited or self.gradation is not None

    def _check_sizing(self):
        """Refuse limits and gradations that make no sense."""
        if self.gradation is not None and not 1.0 < self.gradation < float("inf"):
            raise InvalidCase(f"gradation must be above 1, got {self.gradation}")
        if not 0.0 <= self.min_length <= self.max_length or not self.max_length > 0.0:
            raise InvalidCase(
                "min_length must not be negative, nor above max_length, and max_length must be "
                f"positive, got {self.min_length} and {self.max_length}"
            )
        if self.sized and self.algorithm == "thesis":
            raise InvalidCase("the thesis's algorithm knows no min_length, max_length or gradation")

    def _check_bound(self):
        """Refuse what makes no sense with, or without, an error bound."""
        angle = self.max_normal_angle
        if self.max_error is None:
            if angle is not None:
                raise InvalidCase("max_normal_angle belongs to max_error: give one")
            return
        if not 0.0 < self.max_error < float("inf"):
            raise InvalidCase(f"max_error must be positive, got {self.max_error}")
        if self.vertices is not None:
            raise InvalidCase("ask for a number of vertices or for max_error, not for both")
        if self.algorithm == "thesis" or self.smoothing > 0:
            raise InvalidCase("max_error holds to the surface as it is: without the thesis's "
                              "algorithm, and without smoothing")  # fmt: skip
        if angle is not None and not 0.0 < angle <= 180.0:
            raise InvalidCase(f"max_normal_angle must be in (0, 180], got {angle}")
        if not 0.0 <= self.least_angle < 30.0:
            raise InvalidCase(f"least_angle must be in [0, 30), got {self.least_angle}")
