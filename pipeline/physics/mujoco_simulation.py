"""A MuJoCo model that grows until it is first stepped or read, and its state from then on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.physics.mujoco_contacts import Surface, add_pairs
from pipeline.records.parameters.physics import PhysicsParameters

MEMORY = 2**26  # bytes for contacts and constraints; only what is used is taken
MEAN_INERTIA = 0.1  # kg, kg m2: the scale by which the solver judges its residual, whatever a carrier weighs
DIVERGED = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
FULL = (mujoco.mjtWarning.mjWARN_CONTACTFULL, mujoco.mjtWarning.mjWARN_CNSTRFULL)

# MuJoCo would print them and write MUJOCO_LOG.TXT; what they say is read from the counters of the state.
mujoco.set_mju_user_warning(lambda message: None)


class Simulation:
    """What world, robots and bodies share."""

    def __init__(self, settings: PhysicsParameters, gravity: ArrayLike) -> None:
        """Begin an empty model with ``gravity`` (3,), m/s2, world frame."""
        self.settings = settings
        self.surfaces: list[Surface] = []
        self.never_meeting: set[frozenset[str]] = set()  # pairs of bodies
        self.corrections: list[Callable[[Any], None]] = []  # of the built model
        self.beginnings: list[Callable[[Any, Any], None]] = []  # of its state
        self.diverged = False
        self._spec = mujoco.MjSpec()
        option = self._spec.option
        option.timestep = 1.0 / (settings.frequency * settings.mujoco.substeps)
        option.gravity = np.asarray(gravity, np.float64)
        option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        option.impratio = settings.mujoco.friction_stiffness
        option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE  # few joints; the sparse solver of 4.0.0 is wrong
        option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a lost object must not come back
        self._spec.memory = MEMORY
        self._built: tuple[Any, Any] | None = None
        self._names: dict[int, str] = {}  # of bodies
        self._impulses: list[tuple[NDArray[np.int32], NDArray[np.float64]]] = []  # bodies (n, 2), on the second (n, 3)

    @property
    def spec(self) -> Any:
        """The model, to add to it."""
        if self._built is not None:
            raise RuntimeError("a world that was stepped or read takes nothing more; make another one")
        return self._spec

    @property
    def model(self) -> Any:
        """The built model (``mujoco.MjModel``)."""
        return self._build()[0]

    @property
    def data(self) -> Any:
        """Its state (``mujoco.MjData``)."""
        return self._build()[1]

    def _build(self) -> tuple[Any, Any]:
        if self._built is None:
            add_pairs(self._spec, self.surfaces, self._never_meet, self.settings)
            model = self._spec.compile()
            for correct in self.corrections:
                correct(model)
            data = mujoco.MjData(model)
            mujoco.mj_setConst(model, data)  # what follows from what was corrected; this moves everything to zero
            model.stat.meaninertia = MEAN_INERTIA
            mujoco.mj_resetData(model, data)
            for begin in self.beginnings:
                begin(model, data)
            self._names = {index: model.body(index).name for index in range(model.nbody)}
            self._built = model, data
        return self._built

    def _never_meet(self, first: str, second: str) -> bool:
        return frozenset((first, second)) in self.never_meeting

    def step(self, count: int, watched: bool = True) -> None:
        """Advance by ``count`` physics steps; do nothing once diverged.

        Args:
            watched: remember the impulses of the last step.
        """
        model, data = self._build()
        if self.diverged:
            return
        substeps = self.settings.mujoco.substeps
        if data.xfrc_applied.any() and count > 1:  # a push lasts one step
            self.step(1, watched=False)
            count -= 1
        unwatched = count - 1 if watched else count
        if unwatched:
            mujoco.mj_step(model, data, unwatched * substeps)
        self._impulses = []
        for _ in range(substeps if watched else 0):
            mujoco.mj_step(model, data)
            self._remember_contacts()
        data.xfrc_applied[:] = 0.0
        if any(data.warning[kind].number for kind in FULL):
            raise MemoryError(f"MuJoCo has no room left for contacts in {MEMORY} bytes")
        self.diverged = any(data.warning[kind].number for kind in DIVERGED)

    def push(self, body: str, force: ArrayLike) -> None:
        """Apply ``force`` (3,), N, world frame, at a body's centre of mass during the next step."""
        self.data.xfrc_applied[self.model.body(body).id, :3] += np.asarray(force, np.float64)

    def _remember_contacts(self) -> None:
        """Add the impulses of the time step just made."""
        model, data = self._build()
        contact = data.contact
        pressing = np.flatnonzero(contact.efc_address >= 0)
        if not len(pressing):
            return
        force = data.efc_force[contact.efc_address[pressing, None] + np.arange(3)]  # normal and two tangents
        axes = contact.frame[pressing].reshape(-1, 3, 3)  # rows; the first points from the first shape to the second
        impulse = np.einsum("ni,nij->nj", force, axes) * model.opt.timestep
        self._impulses.append((model.geom_bodyid[contact.geom[pressing]], impulse))

    def impulses_on(self, body: str) -> dict[str, NDArray[np.float64]]:
        """Return the impulse (3,), N s, world frame, from each body that pressed on ``body`` in the last step."""
        own = self.model.body(body).id
        total: dict[str, NDArray[np.float64]] = {}
        for pairs, impulses in self._impulses:
            for (first, second), impulse in zip(pairs, impulses, strict=True):
                if own not in (first, second) or not np.any(impulse):
                    continue
                other, sign = (first, 1.0) if second == own else (second, -1.0)
                name = self._names[other]
                total[name] = total.get(name, np.zeros(3)) + sign * impulse
        return total
