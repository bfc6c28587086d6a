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


def _incompressible(value):
    return "0.5 is incompressible; take 0.49" if value == 0.5 else ""


Positive = fields.number(above=0.0)
NotNegative = fields.number(at_least=0.0)
PositiveOrAuto = fields.number(above=0.0, words=("auto",))
Fraction = fields.number(above=0.0, below=1.0, hint=_percent)
PositiveLength = fields.length(above=0.0)
NotNegativeLength = fields.length(at_least=0.0)
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


class SlabSection(Section):
    """A plane of any direction, or what lies within half a thickness of it."""

    point: Corner = Field(description="a point of it [m]")
    normal: Vector = Field(description="its normal, of any length, as [1, 1, 0]")
    thickness: NotNegativeLength = Field(0.0, description="0: the plane itself [m]")

    @model_validator(mode="after")
    def _has_a_direction(self):
        if not any(self.normal):
            raise fields.refusal("must have a normal that is not zero")
        return self


class SphereSection(Section):
    """A ball."""

    center: Corner = Field(description="its centre [m]")
    radius: PositiveLength = Field(description="its radius [m]")


class CylinderSection(Section):
    """A circular cylinder."""

    start: Corner = Field(description="one end of its axis [m]")
    end: Corner = Field(description="the other end of its axis [m]")
    radius: PositiveLength = Field(description="its radius [m]")

    @model_validator(mode="after")
    def _has_length(self):
        if self.start == self.end:
            raise fields.refusal("must have start and end apart")
        return self


KINDS = ("box", "plane", "slab", "sphere", "cylinder", "surface")


class Region(Section):
    """A part of space: a box of ranges, a plane, a slab, a sphere, a cylinder, or the inside of a
    surface."""

    box: fields.BoxRanges = Field(None, description="[[x0, x1], [y0, y1], [z0, z1]], null = open")
    plane: fields.PlaneText = Field(None, description="an axis-parallel plane, as z=20mm")
    x: fields.Range = Field(None, description="with plane: the range of x, null = open")
    y: fields.Range = Field(None, description="with plane: the range of y, null = open")
    z: fields.Range = Field(None, description="with plane: the range of z, null = open")
    slab: SlabSection | None = Field(None, description="point, normal and thickness")
    sphere: SphereSection | None = Field(None, description="center and radius")
    cylinder: CylinderSection | None = Field(None, description="start, end and radius")
    surface: str | None = Field(
        None, description="the inside of a closed STL, PLY, OBJ or OFF file, relative to the case"
    )
    unit: Literal["m", "cm", "mm"] = Field("mm", description="the unit of the surface file")

    @model_validator(mode="after")
    def _one_of_all(self):
        if sum(getattr(self, kind) is not None for kind in KINDS) != 1:
            raise fields.refusal("must give one of box, plane, slab, sphere, cylinder and surface")
        given = [axis for axis in "xyz" if getattr(self, axis) != (None, None)]
        if given and self.plane is None:
            raise fields.refusal(f"takes the range {given[0]} with a plane only, as plane: z=20mm")
        if given and self.plane[0] in given:
            raise fields.refusal(
                f"fixes {self.plane[0]} by its plane and cannot take a range of it too"
            )
        return self


class SupportSection(Region):
    """Where the part is held, in which directions, and how."""

    fixed: fields.Directions = Field(("x", "y", "z"), description="directions that are held")
    displacement: Corner = Field(
        (0.0, 0.0, 0.0), description="where the held directions are moved to [m], as [0, 0, -1mm]"
    )
    stiffness: fields.number(above=0.0, nullable=True) = Field(
        None, description="of springs instead of a rigid support [N/m^3]: force per area and metre"
    )

    @model_validator(mode="after")
    def _moves_what_it_holds(self):
        loose = [a for a, d in zip("xyz", self.displacement) if d and a not in self.fixed]
        if loose:
            raise fields.refusal(f"moves {loose[0]}, which is not among the directions of fixed")
        if self.stiffness is not None and any(self.displacement):
            raise fields.refusal("takes a stiffness or a displacement, not both")
        return self


class LoadSection(Region):
    """Where the part is loaded, and by which traction."""

    traction: Vector = Field(description="force per area [N/m^2], as [0, 0, -2400]")


class LoadCaseSection(Section):
    """What acts at the same time."""

    loads: fields.Names = Field((), description="names of the loads that act")
    weight: Positive = Field(1.0, description="of its compliance in the objective")
    gravity: bool = Field(True, description="whether gravity acts")
    displacements: fields.Names = Field(
        (), description="names of the supports whose displacement is imposed; others stay at 0"
    )


class PassiveSection(Region):
    """Where the material is given: solid or void."""

    phase: Literal["solid", "void"] = Field(description="what fills the region")


_STIFFNESS = ("lame_lambda", "lame_mu", "young", "poisson")


class MaterialSection(Section):
    """Isotropic linear elasticity, by lame_lambda and lame_mu or by young and poisson; density."""

    lame_lambda: fields.number(nullable=True) = Field(
        None, description="Lame's first parameter [Pa]; 1599e6 if no stiffness is given"
    )
    lame_mu: fields.number(above=0.0, nullable=True) = Field(
        None, description="Lame's second parameter, the shear modulus [Pa]; likewise 685e6"
    )
    young: fields.number(above=0.0, nullable=True) = Field(
        None, description="Young's modulus E [Pa], as 1.85e9"
    )
    poisson: fields.number(above=-1.0, below=0.5, nullable=True, hint=_incompressible) = Field(
        None, description="Poisson's ratio nu, as 0.35"
    )
    density: NotNegative = Field(1240.0, description="mass density [kg/m^3]")
    void_ratio: fields.number(above=0.0, below=1.0) = Field(
        1e-4, description="stiffness of the void, as a share of the material's"
    )

    @model_validator(mode="before")
    @classmethod
    def _polylactide_if_nothing_is_said(cls, value):
        said = isinstance(value, dict) and any(value.get(key) is not None for key in _STIFFNESS)
        if isinstance(value, dict) and not said:
            return {**value, "lame_lambda": 1599e6, "lame_mu": 685e6}
        return value

    @model_validator(mode="after")
    def _one_pair(self):
        lame, engineer = (self.lame_lambda, self.lame_mu), (self.young, self.poisson)
        given = [any(value is not None for value in pair) for pair in (lame, engineer)]
        if all(given):
            raise fields.refusal("takes lame_lambda and lame_mu, or young and poisson, not both")
        if (given[0] and None in lame) or (given[1] and None in engineer):
            raise fields.refusal("needs both lame_lambda and lame_mu, or both young and poisson")
        if given[0] and not 3.0 * lame[0] + 2.0 * lame[1] > 0.0:
            raise fields.refusal(
                "needs 3 lame_lambda + 2 lame_mu > 0 (the bulk modulus is positive)"
            )
        return self

    @property
    def lame(self):
        """(lambda, mu) [Pa]."""
        if self.young is not None:
            young, poisson = self.young, self.poisson
            mu = young / (2.0 * (1.0 + poisson))
            return 2.0 * mu * poisson / (1.0 - 2.0 * poisson), mu
        return self.lame_lambda, self.lame_mu


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
    levels: fields.whole(at_least=1, at_most=6) = Field(
        1, description="nested meshes, coarse to fine; edges halve from one to the next"
    )
    adapted: bool = Field(
        False,
        description="refine the last level only where the design before it has its interface",
    )
    cache: bool = Field(True, description="keep meshes on disk and use them again")
    time_limit: fields.number(above=0.0) = Field(
        1800.0, description="seconds after which meshing gives up"
    )

    @model_validator(mode="before")
    @classmethod
    def _two_levels_if_adapted(cls, value):
        if isinstance(value, dict) and value.get("adapted") is True:
            return {"levels": 2, **value}
        return value

    @model_validator(mode="after")
    def _one_of_both(self):
        if (self.tets is None) == (self.edge_length is None):
            raise fields.refusal("must give either tets or edge_length")
        return self

    @model_validator(mode="after")
    def _adapted_to_a_coarser_one(self):
        if self.adapted and self.levels == 1:
            raise fields.refusal("can take adapted: true with levels: 2 or more only")
        if self.adapted and self.kind == "bcc":
            raise fields.refusal("can take adapted: true with kind: pytetwild only")
        return self


class TopoptSection(Section):
    """The optimisation problem and how it is solved."""

    volume_fraction: Fraction = Field(description="share of the domain that is material")
    gamma: PositiveOrAuto = Field("auto", description="weight of the interface energy [J/m^2]")
    eps: fields.length(above=0.0, words=("auto",)) = Field(
        "auto", description="interface parameter [m]; the interface is 2.2 eps wide"
    )
    steps: fields.whole(at_least=0, at_most=10**6) = Field(
        200, description="accepted steps at most, on each level"
    )
    method: Literal["vmpt", "allen_cahn"] = Field(
        "vmpt",
        description="vmpt: projected gradients in a metric that learns; allen_cahn: the flow",
    )
    step: Literal["controlled", "variable_metric", "fixed"] = Field(
        "variable_metric",
        description="fixed (allen_cahn only): every step with the first tau, as the thesis ran it",
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
        0.1, description="loosest relative residual of a state solve"
    )

    @model_validator(mode="after")
    def _fixed_steps_are_the_flow_s(self):
        if self.step == "fixed" and self.method != "allen_cahn":
            raise fields.refusal("can take step: fixed with method: allen_cahn only")
        return self


class IsosurfaceSection(Section):
    """The surface extracted from the phase field."""

    level: fields.number(above=0.0, below=1.0, words=("volume",)) = Field(
        0.5, description="phi on the surface; volume: the level that encloses volume_fraction"
    )
    crossing: Literal["quadratic", "newton", "sine", "linear"] = Field(
        "quadratic", description="how phi runs along an edge of the mesh"
    )
    spread: fields.number(at_least=0.0, below=0.5) = Field(
        0.0, description="share of an edge by which vertices slide away from the mesh's nodes"
    )
    diffusion: fields.number(at_least=0.0, at_most=10.0) = Field(
        0.0, description="smooth phi itself before, over so many edge lengths, by one implicit step"
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


_TARGETS = ("vertices", "edge_length", "edge_factor")
_NOT_OF_THE_THESIS = ("min_length", "max_length", "gradation", "quality")


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
    min_length: fields.length(above=0.0, nullable=True) = Field(
        None, description="shorter edges are collapsed unless features need them [m]"
    )
    max_length: fields.length(above=0.0, nullable=True) = Field(
        None, description="no edge is longer [m]"
    )
    gradation: fields.number(above=1.0, nullable=True) = Field(
        None, description="how many times longer edges may be from one triangle to the next"
    )
    quality: Literal["3d", "6d"] | None = Field(
        None, description="spend time on the worst angles, in space or in the embedding"
    )
    iterations: fields.whole(at_least=0, at_most=1000) = Field(10, description="outer iterations")
    algorithm: Literal["default", "thesis"] = Field(
        "default", description="thesis: its Algorithm 2 as it stands"
    )

    @model_validator(mode="before")
    @classmethod
    def _as_many_as_before_if_nothing_is_said(cls, value):
        if isinstance(value, dict) and all(value.get(key) is None for key in _TARGETS):
            return {**value, "vertices": "input"}
        return value

    @model_validator(mode="after")
    def _one_target(self):
        if sum(getattr(self, key) is not None for key in _TARGETS) != 1:
            raise fields.refusal("must give one of vertices, edge_length and edge_factor")
        return self

    @model_validator(mode="after")
    def _lengths_that_go_together(self):
        given = [key for key in _NOT_OF_THE_THESIS if getattr(self, key) is not None]
        if given and self.algorithm == "thesis":
            raise fields.refusal(f"must leave {given[0]} out: the thesis's algorithm has none")
        if None not in (self.min_length, self.max_length) and self.min_length > self.max_length:
            raise fields.refusal("must have min_length below max_length")
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
    loads: dict[fields.Name, LoadSection] = Field({}, description="where it is loaded, by name")
    gravity: Vector = Field((0.0, 0.0, 0.0), description="acceleration [m/s^2], as [0, 0, -9.81]")
    load_cases: dict[fields.Name, LoadCaseSection] = Field(
        {}, description="what acts at the same time, by name; if none is given, everything"
    )
    passive: dict[fields.Name, PassiveSection] = Field(
        {}, description="regions that stay solid or void, by name; volume_fraction counts them"
    )
    mesh: MeshSection = Field(description="the tetrahedral mesh")
    topopt: TopoptSection = Field(description="the optimisation")
    isosurface: IsosurfaceSection = Field(default_factory=IsosurfaceSection)
    smooth: SmoothSection = Field(default_factory=SmoothSection)
    rbf: RbfSection = Field(default_factory=RbfSection)
    remesh: RemeshSection = Field(default_factory=RemeshSection)
    output: OutputSection = Field(default_factory=OutputSection)

    @model_validator(mode="after")
    def _can_be_run(self):
        if not self.supports:
            raise fields.refusal("must have at least one support")
        moved = [name for name, support in self.supports.items() if any(support.displacement)]
        if not (self.loads or any(self.gravity) or moved):
            raise fields.refusal("must have at least one load, gravity, or a displaced support")
        if self.mesh.kind == "bcc" and self.domain.box is None:
            raise fields.refusal("can use the bcc mesh on a box only")
        return self
