"""What a case file may say: every key, its default, its bounds, and what it means.

All quantities are SI; a length may carry a unit ("14mm"). The models refuse unknown keys and
never guess: `load.py` turns their complaints into sentences with file and line.
"""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from cases import fields


class Section(BaseModel):
    """A mapping of the case file whose keys are all known."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, validate_default=True)


def _percent(value):
    return f"percent? write {value / 100:g}" if 1.0 < value < 100.0 else ""


Positive = fields.number(above=0.0)
NotNegative = fields.number(at_least=0.0)
PositiveOrAuto = fields.number(above=0.0, words=("auto",))
Fraction = fields.number(above=0.0, below=1.0, hint=_percent)
PositiveLength = fields.length(above=0.0)
Vector = fields.vector()
Corner = fields.vector(fields.quantities.length, "lengths")


class BoxSection(Section):
    """An axis-parallel box."""

    lower: Corner = Field(description="the corner with the least coordinates [m]")
    upper: Corner = Field(description="the corner with the greatest coordinates [m]")

    @model_validator(mode="after")
    def _has_volume(self):
        if not all(low < high for low, high in zip(self.lower, self.upper)):
            raise fields.refusal("must have each coordinate of upper above that of lower")
        return self


class Domain(Section):
    """The design domain: a box, or the inside of a closed surface."""

    box: BoxSection | None = Field(None, description="an axis-parallel box")
    surface: str | None = Field(
        None, description="an STL, PLY, OBJ or OFF file, relative to the case file"
    )
    unit: Literal["m", "cm", "mm"] = Field("mm", description="the unit of the surface file")

    @model_validator(mode="after")
    def _one_of_both(self):
        if (self.box is None) == (self.surface is None):
            raise fields.refusal("must give either a box or a surface")
        return self


class Region(Section):
    """A part of the boundary: a box of ranges, or a plane with ranges along its other axes."""

    box: fields.BoxRanges = Field(None, description="[[x0, x1], [y0, y1], [z0, z1]], null = open")
    plane: fields.PlaneText = Field(None, description="an axis-parallel plane, as z=20mm")
    x: fields.Range = Field(None, description="with plane: the range of x, null = open")
    y: fields.Range = Field(None, description="with plane: the range of y, null = open")
    z: fields.Range = Field(None, description="with plane: the range of z, null = open")

    @model_validator(mode="after")
    def _one_of_both(self):
        if (self.box is None) == (self.plane is None):
            raise fields.refusal("must give either a box or a plane")
        given = [axis for axis in "xyz" if getattr(self, axis) != (None, None)]
        if self.box is not None and given:
            raise fields.refusal(f"takes the range {given[0]} with a plane only, not with a box")
        if self.plane is not None and self.plane[0] in given:
            raise fields.refusal(
                f"fixes {self.plane[0]} by its plane and cannot take a range of it too"
            )
        return self


class SupportSection(Region):
    """Where the part is held, and in which directions."""

    fixed: fields.Directions = Field(("x", "y", "z"), description="directions that are held")


class LoadSection(Region):
    """Where the part is loaded, and by which traction."""

    traction: Vector = Field(description="force per area [N/m^2], as [0, 0, -2400]")


class MaterialSection(Section):
    """Isotropic linear elasticity and the density."""

    lame_lambda: NotNegative = Field(1599e6, description="Lame's first parameter [Pa]")
    lame_mu: Positive = Field(685e6, description="Lame's second parameter [Pa]")
    density: NotNegative = Field(1240.0, description="mass density [kg/m^3]")
    void_ratio: fields.number(above=0.0, below=1.0) = Field(
        1e-4, description="stiffness of the void, as a share of the material's"
    )


class MeshSection(Section):
    """The tetrahedral mesh: by count or by edge length."""

    kind: Literal["pytetwild", "bcc"] = Field(
        "pytetwild", description="bcc: a structured mesh, for boxes only"
    )
    tets: fields.whole(at_least=20, at_most=10**8, nullable=True) = Field(
        None, description="number of tetrahedra aimed at"
    )
    edge_length: fields.length(above=0.0, nullable=True) = Field(
        None, description="edge length aimed at [m]"
    )
    cache: bool = Field(True, description="keep meshes on disk and use them again")

    @model_validator(mode="after")
    def _one_of_both(self):
        if (self.tets is None) == (self.edge_length is None):
            raise fields.refusal("must give either tets or edge_length")
        return self


class TopoptSection(Section):
    """The optimisation problem and how it is solved."""

    volume_fraction: Fraction = Field(description="share of the domain that is material")
    gamma: PositiveOrAuto = Field("auto", description="weight of the interface energy [J/m^2]")
    eps: fields.length(above=0.0, words=("auto",)) = Field(
        "auto", description="interface parameter [m]; the interface is 2.2 eps wide"
    )
    steps: fields.whole(at_least=0, at_most=10**6) = Field(
        200, description="accepted steps at most"
    )
    step: Literal["controlled", "variable_metric", "fixed"] = Field(
        "variable_metric", description="fixed: every step with the first tau, as the thesis ran it"
    )
    tau: PositiveOrAuto = Field("auto", description="(first) step size of the flow [1/Pa]")
    tolerance: NotNegative = Field(
        1e-3, description="stop when the KKT residual is below this; 0 never stops by it"
    )
    stagnation: NotNegative = Field(
        1e-4, description="stop when J fell by less than this share in 5 steps; 0 never stops"
    )
    solver: Literal["auto", "multigrid", "pyamg", "direct"] = Field(
        "auto", description="linear solver of the state problem"
    )
    state_tolerance: fields.number(above=0.0, at_most=0.1) = Field(
        1e-4, description="loosest relative residual of a state solve"
    )


class IsosurfaceSection(Section):
    """The surface extracted from the phase field."""

    level: fields.number(above=0.0, below=1.0, words=("volume",)) = Field(
        0.5, description="phi on the surface; volume: the level that encloses volume_fraction"
    )
    islands: Literal["drop", "keep"] = Field(
        "drop", description="what becomes of pieces that touch no load or no support"
    )


class SmoothSection(Section):
    """Taubin smoothing and sliver repair before the interpolation."""

    taubin: Literal["default", "thesis", "off"] = Field(
        "default", description="thesis: 0.40 / -0.50 x 40, which inflates"
    )
    iterations: fields.whole(at_least=0, at_most=10000, words=("auto",)) = Field(
        "auto", description="pairs of steps"
    )
    volume: Literal["isosurface", "fraction", "free"] = Field(
        "isosurface",
        description="set the volume by a normal offset: to the isosurface's, or to "
        "volume_fraction of the domain; free lets it drift",
    )
    repair: bool = Field(True, description="collapse and flip slivers before the interpolation")


class RbfSection(Section):
    """The radial-basis interpolant of the smooth parts."""

    form: Literal["hermite", "offsets"] = Field("hermite", description="offsets: the thesis's")
    support_radius: fields.length(above=0.0, words=("auto",)) = Field(
        "auto", description="support of the kernel [m]; auto: six median edges"
    )
    support_factor: fields.number(above=0.0, nullable=True) = Field(
        None, description="support in longest edges of the input (the thesis: 2.5)"
    )
    tolerance: fields.number(above=0.0, at_most=1e-2) = Field(
        1e-8, description="relative residual of the fit"
    )

    @model_validator(mode="after")
    def _at_most_one(self):
        if self.support_factor is not None and self.support_radius != "auto":
            raise fields.refusal("must give support_radius or support_factor, not both")
        return self


class RemeshSection(Section):
    """The curvature-adapted final surface."""

    vertices: fields.whole(at_least=4, at_most=10**9, words=("input",), nullable=True) = Field(
        None, description="number of vertices aimed at; input: as many as the smoothed surface"
    )
    edge_length: fields.length(above=0.0, nullable=True) = Field(
        None, description="6D edge length aimed at [m]"
    )
    edge_factor: fields.number(above=0.0, nullable=True) = Field(
        None, description="6D edge length in longest edges of the input (the thesis: 2)"
    )
    sigma: fields.Sigma = Field(
        0.05, description="weight of the normals: in bounding-box diagonals, or with a unit, 14mm"
    )
    iterations: fields.whole(at_least=0, at_most=1000) = Field(10, description="outer iterations")
    algorithm: Literal["default", "thesis"] = Field(
        "default", description="thesis: its Algorithm 2 as it stands"
    )

    @model_validator(mode="after")
    def _one_target(self):
        given = [
            n for n in ("vertices", "edge_length", "edge_factor") if getattr(self, n) is not None
        ]
        if len(given) != 1:
            raise fields.refusal("must give one of vertices, edge_length and edge_factor")
        return self


class OutputSection(Section):
    """What is written beside the surfaces."""

    pictures: bool = Field(True, description="render pictures/*.png")
    snapshots: fields.whole(at_least=0, at_most=1000) = Field(
        4, description="phase fields written on the way, beside the last"
    )


class Case(Section):
    """One part: its domain, supports and loads, and how it is optimised and meshed."""

    name: fields.Name = Field(description="a short name; the output folder's default")
    title: str = Field("", description="what the part is, in words")
    seed: fields.whole(at_least=0, at_most=2**32 - 1) = Field(1, description="of all randomness")
    domain: Domain = Field(description="the design domain")
    symmetry: fields.Planes = Field((), description="planes about which the part is mirrored")
    material: MaterialSection = Field(default_factory=MaterialSection)
    supports: dict[fields.Name, SupportSection] = Field(description="where it is held, by name")
    loads: dict[fields.Name, LoadSection] = Field(description="where it is loaded, by name")
    gravity: Vector = Field((0.0, 0.0, 0.0), description="acceleration [m/s^2], as [0, 0, -9.81]")
    mesh: MeshSection = Field(description="the tetrahedral mesh")
    topopt: TopoptSection = Field(description="the optimisation")
    isosurface: IsosurfaceSection = Field(default_factory=IsosurfaceSection)
    smooth: SmoothSection = Field(default_factory=SmoothSection)
    rbf: RbfSection = Field(default_factory=RbfSection)
    remesh: RemeshSection = Field(default_factory=lambda: RemeshSection(vertices="input"))
    output: OutputSection = Field(default_factory=OutputSection)

    @model_validator(mode="after")
    def _can_be_run(self):
        if not self.supports:
            raise fields.refusal("must have at least one support")
        if not self.loads and not any(self.gravity):
            raise fields.refusal("must have at least one load, or gravity")
        if self.mesh.kind == "bcc" and self.domain.box is None:
            raise fields.refusal("can use the bcc mesh on a box only")
        return self
