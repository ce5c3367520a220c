"""An MJCF as a URDF: read by MuJoCo's own compiler, so that its defaults, frames and orientations mean what it says."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from pipeline.hand.meshes import write_mesh
from pipeline.hand.standard import generated_mesh, origin_element
from pipeline.records.errors import UserError, one_sentence

HINGE, SLIDE, FREE = (
    int(kind) for kind in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_FREE)
)
SHAPES = {
    int(mujoco.mjtGeom.mjGEOM_SPHERE): lambda size: ("sphere", {"radius": repr(size[0])}),
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): lambda size: (
        "capsule",
        {"radius": repr(size[0]), "length": repr(2 * size[1])},
    ),
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): lambda size: (
        "cylinder",
        {"radius": repr(size[0]), "length": repr(2 * size[1])},
    ),
    int(mujoco.mjtGeom.mjGEOM_BOX): lambda size: ("box", {"size": " ".join(repr(2 * half) for half in size)}),
}
MESH, ELLIPSOID = int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_ELLIPSOID)


def urdf_of_mjcf(file: Path) -> ElementTree.Element:
    """Return the bodies of an MJCF as links of a URDF; what couples joints linearly becomes ``mimic``.

    A freely moving root is fixed. Joints that one actuated tendon pulls together share its pull in proportion to their
    coefficients: the first of them drives the others.

    Raises:
        UserError: MuJoCo cannot read it, or it moves in ways that a tree of turning and sliding joints cannot.
    """
    try:
        model = mujoco.MjSpec.from_file(str(file)).compile()
    except ValueError as error:
        raise UserError(f"{file} cannot be read by MuJoCo ({' '.join(str(error).split())}); mend it there.") from error
    couplings = _Couplings(model)
    mistakes = [*couplings.mistakes, *_unreadable(model)]
    if mistakes:
        raise UserError(one_sentence(file, mistakes))
    robot = ElementTree.Element("robot", name=file.parent.parent.name)
    roots = [body for body in range(1, model.nbody) if model.body_parentid[body] == 0]
    if len(roots) != 1:
        ElementTree.SubElement(robot, "link", name="world")
    for body in range(1, model.nbody):
        robot.append(_link(model, body, file))
        if len(roots) != 1 or body != roots[0]:
            robot.extend(_joints(model, body, couplings))
    return robot


def _name(model: Any, kind: str, index: int) -> str:
    return str(getattr(model, kind)(index).name) or f"{kind}{index}"


def _unreadable(model: Any) -> Iterator[str]:
    for joint in range(model.njnt):
        top = model.body_parentid[model.jnt_bodyid[joint]] == 0
        if model.jnt_type[joint] not in (HINGE, SLIDE) and not (top and model.jnt_type[joint] == FREE):
            yield f"the joint {_name(model, 'joint', joint)!r} turns about more than one axis; use several hinges"
    for equality in range(model.neq):
        if int(model.eq_type[equality]) in (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)):
            yield (
                f"the constraint {_name(model, 'eq', equality)!r} closes a loop of links; describe the loop as a tree "
                "in which joints follow one another (an equality of joints)"
            )
    for geom in range(model.ngeom):
        kind = int(model.geom_type[geom])
        if model.geom_bodyid[geom] and kind not in (*SHAPES, MESH, ELLIPSOID):
            yield f"the shape {_name(model, 'geom', geom)!r} is a plane, height field or SDF; use another kind"


class _Couplings:
    """How joints follow others, and the largest torque or force of each."""

    def __init__(self, model: Any) -> None:
        self.follows: dict[int, tuple[int, float, float]] = {}  # joint: driver, multiplier, offset
        self.effort: dict[int, float] = {}
        self.mistakes: list[str] = []
        self._equalities(model)
        driven = self._actuators(model)
        if not model.nu:
            return
        for joint in range(model.njnt):
            if joint not in driven and joint not in self.follows and model.jnt_type[joint] in (HINGE, SLIDE):
                name = _name(model, "joint", joint)
                self.mistakes.append(
                    f"no actuator moves the joint {name!r}, and it follows no other; add one, or an equality of joints"
                )

    def _equalities(self, model: Any) -> None:
        for index in range(model.neq):
            if int(model.eq_type[index]) != int(mujoco.mjtEq.mjEQ_JOINT) or model.eq_obj2id[index] < 0:
                continue
            one, other = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
            constant, slope, *bends = model.eq_data[index, :5].tolist()
            if any(bends):
                self.mistakes.append(
                    f"the joint {_name(model, 'joint', one)!r} follows another one by a curve; use a straight line"
                )
            rest, rest_of_other = (float(model.qpos0[model.jnt_qposadr[joint]]) for joint in (one, other))
            self.follows[one] = (other, slope, rest + constant - slope * rest_of_other)

    def _actuators(self, model: Any) -> set[int]:
        driven: set[int] = set()
        for index in range(model.nu):
            limited = bool(model.actuator_forcelimited[index])
            force = float(np.abs(model.actuator_forcerange[index]).max()) * abs(float(model.actuator_gear[index, 0]))
            target = int(model.actuator_trnid[index, 0])
            kind = int(model.actuator_trntype[index])
            if kind == int(mujoco.mjtTrn.mjTRN_TENDON):
                pulled = self._tendon(model, target)
            elif kind == int(mujoco.mjtTrn.mjTRN_JOINT):
                pulled = {target: 1.0}
            else:
                name = _name(model, "actuator", index)
                self.mistakes.append(f"the actuator {name!r} moves neither a joint nor a tendon; let it move a joint")
                continue
            driven |= set(pulled)
            self.effort |= {joint: force * abs(share) for joint, share in pulled.items() if limited}
        return driven

    def _tendon(self, model: Any, tendon: int) -> dict[int, float]:
        """Let the joints of a tendon follow the first of them; return how strongly it pulls each."""
        entries = range(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
        if any(int(model.wrap_type[entry]) != int(mujoco.mjtWrap.mjWRAP_JOINT) for entry in entries):
            name = _name(model, "tendon", tendon)
            self.mistakes.append(f"the tendon {name!r} runs through space; only those of joints (<fixed>) can be read")
            return {}
        pulls = {int(model.wrap_objid[entry]): float(model.wrap_prm[entry]) for entry in entries}
        first = min(pulls)
        for joint in sorted(pulls):
            if joint != first and joint not in self.follows and self.follows.get(first, (None,))[0] != joint:
                self.follows[joint] = (first, pulls[joint] / pulls[first], 0.0)
        return pulls


def _pose(position: NDArray[np.float64], quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    T[:3, 3] = position
    return T


def _shift(position: NDArray[np.float64]) -> NDArray[np.float64]:
    return _pose(position, np.array([1.0, 0.0, 0.0, 0.0]))


def _link(model: Any, body: int, file: Path) -> ElementTree.Element:
    link = ElementTree.Element("link", name=_name(model, "body", body))
    inertial = ElementTree.SubElement(link, "inertial")
    inertial.append(origin_element(_pose(model.body_ipos[body], model.body_iquat[body])))
    ElementTree.SubElement(inertial, "mass", value=repr(float(model.body_mass[body])))
    xx, yy, zz = model.body_inertia[body].tolist()
    moments = {"ixx": xx, "ixy": 0.0, "ixz": 0.0, "iyy": yy, "iyz": 0.0, "izz": zz}
    ElementTree.SubElement(inertial, "inertia", {name: repr(value) for name, value in moments.items()})
    for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
        collides = model.geom_contype[geom] or model.geom_conaffinity[geom]
        shape = ElementTree.SubElement(link, "collision" if collides else "visual")
        shape.append(origin_element(_pose(model.geom_pos[geom], model.geom_quat[geom])))
        kind, attributes = _geometry(model, geom, bool(collides), file)
        ElementTree.SubElement(ElementTree.SubElement(shape, "geometry"), kind, attributes)
    return link


def _geometry(model: Any, geom: int, hull: bool, file: Path) -> tuple[str, dict[str, str]]:
    kind, size = int(model.geom_type[geom]), model.geom_size[geom].tolist()
    if kind in SHAPES:
        return SHAPES[kind](size)
    if kind == ELLIPSOID:
        import trimesh

        ball = trimesh.creation.icosphere(subdivisions=3)
        name, vertices, faces = f"ellipsoid{geom}", ball.vertices * size, ball.faces
    else:
        mesh = int(model.geom_dataid[geom])
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        vertices = model.mesh_vert[first : first + count].astype(np.float64)
        faces = model.mesh_face[model.mesh_faceadr[mesh] : model.mesh_faceadr[mesh] + model.mesh_facenum[mesh]]
        name = _name(model, "mesh", mesh)
        if hull:
            corners = ConvexHull(vertices)
            outward = np.einsum(
                "ni,ni->n",
                np.cross(
                    vertices[corners.simplices[:, 1]] - vertices[corners.simplices[:, 0]],
                    vertices[corners.simplices[:, 2]] - vertices[corners.simplices[:, 0]],
                ),
                corners.equations[:, :3],
            )
            faces = np.where(outward[:, None] > 0, corners.simplices, corners.simplices[:, ::-1])
            name += "-hull"
    target = generated_mesh(file, name)
    if not target.is_file():
        write_mesh(target, vertices, faces)
    return "mesh", {"filename": str(target)}


def _joints(model: Any, body: int, couplings: _Couplings) -> Iterator[ElementTree.Element]:
    """Yield what joins a body to its parent: a joint, or several through links without shapes."""
    own, parent = _name(model, "body", body), int(model.body_parentid[body])
    before = _name(model, "body", parent) if parent else "world"
    onward = _pose(model.body_pos[body], model.body_quat[body])
    joints = [model.body_jntadr[body] + index for index in range(model.body_jntnum[body])]
    joints = [joint for joint in joints if model.jnt_type[joint] != FREE]
    for number, joint in enumerate(joints):
        slides = model.jnt_type[joint] == SLIDE
        axis, anchor = model.jnt_axis[joint], np.zeros(3) if slides else model.jnt_pos[joint]
        rest = -float(model.qpos0[model.jnt_qposadr[joint]])
        onward = onward @ _shift(anchor)
        onward = onward @ (_shift(rest * axis) if slides else _pose(np.zeros(3), _turn(rest * axis)))
        last = number == len(joints) - 1 and not anchor.any()
        after = own if last else f"{own}:{_name(model, 'joint', joint)}"
        if not last:
            yield ElementTree.Element("link", name=after)
        yield _joint(model, joint, couplings, (before, after), onward)
        before, onward = after, _shift(-anchor)
    if before != own:
        fixed = ElementTree.Element("joint", name=f"{own}:fixed", type="fixed")
        _ends(fixed, (before, own), onward)
        yield fixed


def _turn(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    quaternion: NDArray[np.float64] = Rotation.from_rotvec(vector).as_quat(scalar_first=True)
    return quaternion


def _ends(joint: ElementTree.Element, links: tuple[str, str], T: NDArray[np.float64]) -> None:
    joint.append(origin_element(T))
    for end, link in zip(("parent", "child"), links, strict=True):
        ElementTree.SubElement(joint, end, link=link)


def _joint(
    model: Any, joint: int, couplings: _Couplings, links: tuple[str, str], T: NDArray[np.float64]
) -> ElementTree.Element:
    kind = "prismatic" if model.jnt_type[joint] == SLIDE else "revolute"
    element = ElementTree.Element("joint", name=_name(model, "joint", joint), type=kind)
    _ends(element, links, T)
    ElementTree.SubElement(element, "axis", xyz=" ".join(map(repr, model.jnt_axis[joint].tolist())))
    limit = {"effort": repr(couplings.effort.get(joint, 0.0)), "velocity": "0"}  # 0: not stated
    if model.jnt_limited[joint]:
        limit |= dict(zip(("lower", "upper"), map(repr, model.jnt_range[joint].tolist()), strict=True))
    ElementTree.SubElement(element, "limit", limit)
    if joint in couplings.follows:
        driver, multiplier, offset = couplings.follows[joint]
        coupling = {"joint": _name(model, "joint", driver), "multiplier": repr(multiplier), "offset": repr(offset)}
        ElementTree.SubElement(element, "mimic", coupling)
    return element
