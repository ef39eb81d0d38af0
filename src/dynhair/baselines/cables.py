"""Hair guides as elastic cables on a moving head, by NVIDIA's Newton (vertex block descent on rigid segments).

Newton is told of lengths in centimetres and of masses in units that make a cable weigh about one unit a centimetre: in
SI units a segment's moment of inertia (1e-12 kg m^2) would be lost beside the 1e-6 that Newton adds to smaller ones.
"""

# Newton declares no types of the arrays in its models and states.
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from dynhair.baselines.simulator_motion import RigidMotion
from dynhair.errors import DynhairError
from dynhair.render.warp_runtime import warp

CENTIMETRES = 100.0
"""In a metre."""

# Mass units / s^2: strands of 40 cm stretch by 1 % at most, and rest on one contact 0.4 mm deep. The solver does not
# hold contacts against joints that are much stiffer: with 1e7 in place of 1e6 hair falls through the head.
STRETCH_STIFFNESS = CONTACT_STIFFNESS = 1e6
CONTACT_GAP = 0.4  # cm around a cable within which contacts are looked for, more than it moves in a step
HAIR = -1  # collision group: cables collide with all that is not of it, and not with each other
CALM_FRAMES = 5
"""For so long hair must be slow to be at rest, and not at a turning point."""

SETTLING_DRAG = 10.0
"""Drag, 1/s, while the hair falls into place; it changes the time that takes, and not the place."""


@dataclass(frozen=True)
class CableParameters:
    """What the hair is made of and how it is simulated.

    The defaults are of a single human hair: density, radius and Young's modulus by Robbins, "Chemical and Physical
    Behavior of Human Hair" (2012), damping by the loss tangent of keratin fibres, about 0.1 at 2 Hz. A wisp of hairs
    that slide past each other bends as one of them, for stiffness and weight both grow with their number.

    Attributes:
        density: of hair, kg/m^3.
        radius: of a hair, metres.
        young: Young's modulus of a hair, Pa.
        relaxation: ratio of a cable's bending viscosity to its bending stiffness (Kelvin-Voigt), seconds.
        drag: rate at which air slows the hair down, 1/s. A lone hair's Stokes drag is about 20/s; a wisp takes the air
            within it along.
        attraction: angular frequency at which a segment swings about its canonical place in the head frame, 1/s: the
            hold of the hair around it, as Maya's "start curve attract" (0.6 in the paper). 0 for none.
        friction: of hair on skin.
        contact_radius: metres; half the thickness of a wisp.
        step: longest time step of the solver, seconds; a frame has a whole number of them.
        iterations: of the solver in a step. Few steps and iterations leave a cable softer than its material: with the
            defaults a cable of 30 cm stretches by 1 to 2 % under its weight (4 % with steps twice as long), and one
            that is held out horizontally hangs as if it had less than a tenth of its bending stiffness (a quarter with
            steps a half as long). What is tuned is what the solver makes of the parameters.
    """

    density: float = 1320.0
    radius: float = 40e-6
    young: float = 3.9e9
    relaxation: float = 0.008
    drag: float = 2.0
    attraction: float = 5.0
    friction: float = 0.3
    contact_radius: float = 5e-4
    step: float = 1 / 240
    iterations: int = 5

    @property
    def bending(self) -> float:
        """Bending stiffness over linear density, ``E I / (rho A) = E r^2 / (4 rho)``, m^4/s^2."""
        return self.young * self.radius**2 / (4 * self.density)


@dataclass(frozen=True)
class Part:
    """A rigid piece of the surface that the hair collides with.

    Attributes:
        vertices: in the frame that moves it, metres.
        faces: triangles, counter-clockwise seen from outside.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]


class Cables:
    """Cables that are clamped to a moving head and collide with it.

    Each strand is a chain of capsules, one a segment. The rest shape is the given one: curvature and twist as well as
    length. The first segment, that is the first two points, moves with the head.

    Args:
        rest: strands in the head frame, metres, root first.
        parts: of the surface; the first one moves with the head.
        parameters: of the material and the solver.
        gravity: world, m/s^2.

    Raises:
        DynhairError: Newton is not installed, or a strand has fewer than three points or two of them in one place.
    """

    def __init__(
        self,
        rest: Float[np.ndarray, "n l 3"],
        parts: Sequence[Part],
        parameters: CableParameters,
        gravity: Float[np.ndarray, " 3"],
    ) -> None:
        lengths = np.linalg.norm(np.diff(rest, axis=1), axis=-1) * CENTIMETRES
        if rest.shape[1] < 3 or not (lengths > 1e-3).all():
            raise DynhairError(
                "a strand that is too short to be a cable", expected="three points or more, all in different places"
            )
        self.parameters, self._newton = parameters, _newton()
        builder = self._newton.ModelBuilder(gravity=tuple(float(g) * CENTIMETRES for g in gravity))
        self._chains = np.array([self._add_chain(builder, strand) for strand in rest * CENTIMETRES])
        # Newton takes a mesh without faces, and crashes when it is looked for.
        self._parts = {place: self._add_part(builder, part) for place, part in enumerate(parts) if len(part.faces)}
        builder.color(balance_colors=False)
        # Chains that are driven by their first segment are no articulations, and the solver needs none.
        self._model = builder.finalize(device="cpu", skip_validation_joints=True)
        self._half = lengths / 2
        self._home = self._model.body_q.numpy().copy()
        self._mass = self._model.body_mass.numpy()[self._chains[:, 1:], None]

    def simulate(
        self, motions: Sequence[RigidMotion], *, settle: float = 2.0, at_rest: float = 0.02
    ) -> Iterator[Float[np.ndarray, "n l 3"]]:
        """Yield the strands in every frame of a motion, world, metres.

        Before the first frame the hair falls into place: the head stands in the first frame's pose until no segment
        moves faster than ``at_rest``.

        Args:
            motions: of the roots and the first part, then of the other parts.
            settle: how long to wait for that, at most, seconds.
            at_rest: metres a second.

        Raises:
            DynhairError: the simulation diverges.
        """
        head = motions[0]
        substeps = math.ceil(1.0 / (head.fps * self.parameters.step) - 1e-6)
        self._step = 1.0 / (head.fps * substeps)
        self._place(motions)
        calm = 0
        for _ in range(math.ceil(settle * head.fps)):
            for _ in range(substeps):
                self._advance(motions, 0.0, SETTLING_DRAG)
            speed = np.linalg.norm(self._velocity(), axis=-1).max()
            calm = calm + 1 if speed < at_rest * CENTIMETRES else 0
            if calm == CALM_FRAMES:
                break
        yield self._strands()
        for substep in range(substeps * (head.frames - 1)):
            self._advance(motions, (substep + 1) * self._step, self.parameters.drag)
            if (substep + 1) % substeps == 0:
                yield self._strands()

    def _add_chain(self, builder: Any, strand: Float[np.ndarray, "l 3"]) -> list[int]:
        """Add a cable, and clamp its first segment."""
        own, wp = self.parameters, warp()
        radius = own.contact_radius * CENTIMETRES
        length = np.linalg.norm(np.diff(strand, axis=0), axis=-1).mean()
        stiffness = own.bending * CENTIMETRES**4 / length  # a joint's, of a linear density of one unit a centimetre
        rod = self._newton.Rod([wp.vec3(*point) for point in strand.tolist()], radius=radius)
        material = self._newton.ModelBuilder.ShapeConfig(
            density=1.0 / (math.pi * radius**2),
            ke=CONTACT_STIFFNESS,
            kd=0.0,
            mu=own.friction,
            gap=CONTACT_GAP,
            collision_group=HAIR,
        )
        bodies, _ = builder.add_rod(
            rod=rod,
            cfg=material,
            stretch_stiffness=STRETCH_STIFFNESS,
            bend_stiffness=float(stiffness),
            bend_damping=float(stiffness * own.relaxation),
            wrap_in_articulation=False,
        )
        builder.body_flags[bodies[0]] = int(self._newton.BodyFlags.KINEMATIC)
        return bodies

    def _add_part(self, builder: Any, part: Part) -> int:
        """Add a piece of the surface as a body that is moved from outside."""
        body = builder.add_body(is_kinematic=True)
        faces = part.faces.astype(np.int32).reshape(-1)
        mesh = self._newton.Mesh((part.vertices * CENTIMETRES).astype(np.float32), faces, compute_inertia=False)
        material = self._newton.ModelBuilder.ShapeConfig(
            density=0.0,
            ke=CONTACT_STIFFNESS,
            kd=0.0,
            mu=self.parameters.friction,
            gap=0.0,
            collision_group=1 + body,  # one of its own, or head and shoulders would collide where they overlap
        )
        builder.add_shape_mesh(body, mesh=mesh, cfg=material)
        return body

    def _place(self, motions: Sequence[RigidMotion]) -> None:
        """Begin anew, everything at rest in the first frame's pose."""
        self._pipeline = self._newton.CollisionPipeline(self._model) if self._parts else None
        self._contacts = self._pipeline.contacts() if self._pipeline else None
        self._solver = self._newton.solvers.SolverVBD(self._model, iterations=self.parameters.iterations)
        self._state, self._next = self._model.state(), self._model.state()
        self._state.body_q.numpy()[self._chains] = _moved(motions[0], 0.0, self._home[self._chains])

    def _advance(self, motions: Sequence[RigidMotion], time: float, drag: float) -> None:
        """Take a step, at the end of which the kinematic bodies are where they are at ``time``."""
        places, forces = self._state.body_q.numpy(), self._state.body_f.numpy()
        hair, roots = self._chains[:, 1:], self._chains[:, 0]
        goals = _moved(motions[0], time, self._home[self._chains])
        places[roots] = goals[:, 0]
        for place, body in self._parts.items():
            places[body] = _moved(motions[place], time, self._home[body])
        pull = self.parameters.attraction**2 * (goals[:, 1:, :3] - places[hair, :3])
        forces[hair, :3] = self._mass * (pull - drag * self._velocity())
        if self._pipeline is not None:
            self._pipeline.collide(self._state, self._contacts)
        self._solver.step(self._state, self._next, None, self._contacts, self._step)
        self._state, self._next = self._next, self._state

    def _velocity(self) -> Float[np.ndarray, "n s 3"]:
        """Of the segments that move freely, cm/s."""
        return self._state.body_qd.numpy()[self._chains[:, 1:], :3]

    def _strands(self) -> Float[np.ndarray, "n l 3"]:
        """The points between the segments, world, metres."""
        places = self._state.body_q.numpy()[self._chains].astype(np.float64)
        if not np.isfinite(places).all():
            raise DynhairError("the simulation of the hair diverges", mend="simulate softer hair or more substeps")
        axes = Rotation.from_quat(places[..., 3:].reshape(-1, 4)).apply([0.0, 0.0, 1.0]).reshape(*places.shape[:2], 3)
        reach = self._half[..., None] * axes
        begins, ends = places[..., :3] - reach, places[..., :3] + reach
        joints = (ends[:, 1:-1] + begins[:, 2:]) / 2
        return np.concatenate([begins[:, :1], ends[:, :1], joints, ends[:, -1:]], axis=1) / CENTIMETRES


def _moved(motion: RigidMotion, time: float, places: Float[np.ndarray, "*b 7"]) -> Float[np.ndarray, "*b 7"]:
    """Newton's transforms (position in centimetres, quaternion xyzw), moved along."""
    rotation, translation = motion(time)
    flat = places.reshape(-1, 7)
    positions = rotation.apply(flat[:, :3]) + translation * CENTIMETRES
    return np.concatenate([positions, (rotation * Rotation.from_quat(flat[:, 3:])).as_quat()], -1).reshape(places.shape)


def _newton() -> ModuleType:
    """Import Newton: slow, and only this baseline needs it.

    Raises:
        DynhairError: it is not installed.
    """
    warp()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it warns of what else is not installed
            import newton
    except ImportError:
        raise DynhairError(
            "the simulator needs the package newton", mend="install it: pip install 'dynhair[simulator]'"
        ) from None
    return newton
