"""A hand's file, URDF or MJCF, as one URDF in standard form: what both engines and Pinocchio load without more ado.

Standard form has one root, absolute paths of meshes that exist, collision meshes in formats that every loader knows, no
capsules (a cylinder and two balls are the same), and an inertia for every link that moves or collides.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from functools import lru_cache
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from pipeline.hand.urdf import end_of, frame_matrix, origin_matrix, rpy_of
from pipeline.records.errors import UserError, one_sentence
from pipeline.records.parameters.hand import UrdfSource

KNOWN_TO_ALL = (".obj", ".stl")  # formats of meshes that every loader reads
FREE = ("floating", "planar")  # joints of a root that moves as a whole


@lru_cache(maxsize=1)
def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="robot-")


def generated_folder() -> Path:
    """Return the folder of this process for files that loaders want; it is removed when the process ends."""
    return Path(_folder().name)


def generated_mesh(source: Path, name: str) -> Path:
    """Return where a mesh made from ``source`` is written."""
    return generated_folder() / f"{sha256(str(source).encode()).hexdigest()[:12]}-{name}.obj"


def source_file(source: UrdfSource, folder: Path) -> Path:
    """Return the path of a hand's URDF or MJCF; packages are found without importing them.

    Args:
        folder: of the hand's description.

    Raises:
        UserError: the package is not installed, or there is no such file, or a folder has none or several.
    """
    if source.package is None:
        file = folder / source.path
    else:
        spec = find_spec(source.package)
        if spec is None or not spec.submodule_search_locations:
            raise UserError(
                f"the package {source.package} is not installed; run `./dev doctor` to set the environment up."
            )
        file = Path(spec.submodule_search_locations[0]) / source.path
    if file.is_dir():
        within = sorted([*file.glob("*.urdf"), *file.glob("*.xml")])
        if len(within) != 1:
            found = ", ".join(one.name for one in within) or "none"
            raise UserError(f"{folder / 'hand.yaml'}: {file} has {found}; name one URDF or MJCF under `urdf` there.")
        return within[0]
    if not file.is_file():
        raise UserError(f"{folder / 'hand.yaml'}: there is no URDF {file}; correct `urdf` there.")
    return file


def standard_urdf(file: Path, root: str | None, density: float) -> ElementTree.Element:
    """Return a URDF or MJCF in standard form.

    Args:
        root: link to take as the root, with what hangs on it; None: the only root there is.
        density: kg/m3, of links with shapes but without inertia.

    Raises:
        UserError: it cannot be read, has several roots, or names meshes that do not exist.
    """
    robot = _parsed(file)
    if robot.tag == "mujoco":
        from pipeline.hand.mjcf import urdf_of_mjcf

        robot = urdf_of_mjcf(file)
    elif robot.tag != "robot":
        raise UserError(f"{file} is neither a URDF (<robot>) nor an MJCF (<mujoco>); correct `urdf` of the hand.")
    _check_ends(robot, file)
    _keep_tree(robot, root, file)
    mistakes = [*_resolve_meshes(robot, file)]
    if mistakes:
        raise UserError(one_sentence(file, mistakes))
    _split_capsules(robot)
    mistakes = [*_convert_meshes(robot)]
    if mistakes:
        raise UserError(one_sentence(file, mistakes))
    _complete_inertias(robot, density)
    return robot


def _parsed(file: Path) -> ElementTree.Element:
    try:
        return ElementTree.parse(file).getroot()
    except OSError as error:
        raise UserError(f"{file} cannot be read ({error.strerror}); correct `urdf` of the hand there.") from error
    except ElementTree.ParseError as error:
        raise UserError(f"{file} is not XML ({error}); mend the URDF.") from error


def _check_ends(robot: ElementTree.Element, file: Path) -> None:
    links = {link.get("name", "") for link in robot.findall("link")}
    mistakes = [
        f"the joint {joint.get('name')!r} has no {end} link; mend the URDF"
        for joint in robot.findall("joint")
        for end in ("parent", "child")
        if end_of(joint, end) not in links
    ]
    if mistakes:
        raise UserError(one_sentence(file, mistakes))


def _keep_tree(robot: ElementTree.Element, root: str | None, file: Path) -> None:
    """Remove what does not hang on the root; a root that only floats before its first link is none."""
    links = {link.get("name", ""): link for link in robot.findall("link")}
    joints = robot.findall("joint")
    if root is None:
        children = {end_of(joint, "child") for joint in joints}
        roots = [name for name in links if name not in children]
        if len(roots) != 1:
            raise UserError(
                f"{file} has {len(roots)} root links ({', '.join(roots)}), and a hand has one tree of links; name the "
                "hand's as `urdf.root` in its description."
            )
        root = roots[0]
        own = [joint for joint in joints if end_of(joint, "parent") == root]
        while len(own) == 1 and own[0].get("type") in FREE and links[root].find("collision") is None:
            root = end_of(own[0], "child")
            own = [joint for joint in joints if end_of(joint, "parent") == root]
    if root not in links:
        raise UserError(f"{file} has no link {root!r}; correct `urdf.root` of the hand.")
    kept = {root}
    kept_joints: list[ElementTree.Element] = []
    while more := [j for j in joints if end_of(j, "parent") in kept and end_of(j, "child") not in kept]:
        kept |= {end_of(joint, "child") for joint in more}
        kept_joints += more
    for joint in joints:
        if joint not in kept_joints:
            robot.remove(joint)
    for name, link in links.items():
        if name not in kept:
            robot.remove(link)


def _resolve_meshes(robot: ElementTree.Element, file: Path) -> Iterator[str]:
    """Make paths of meshes absolute, and yield what cannot be found."""
    missing = set()
    for mesh in robot.iter("mesh"):
        name = mesh.get("filename", "")
        found = _found_mesh(name.removeprefix("file://"), file.parent)
        if found is None:
            missing.add(name)
        else:
            mesh.set("filename", str(found))
    for name in sorted(missing):
        yield f"there is no mesh {name} in the folder of the file or its parents; put it there"


def _found_mesh(name: str, folder: Path) -> Path | None:
    """Return the file of a mesh: relative to a folder or one of its parents, with or without the package's name."""
    if not name.startswith("package://"):
        inside = [Path(name)]
    else:
        within = Path(name.removeprefix("package://"))
        inside = [within, Path(*within.parts[1:])]
    places = (parent / part for parent in (folder, *folder.parents) for part in inside)
    return next((place for place in places if place.is_file()), None)


def _split_capsules(robot: ElementTree.Element) -> None:
    for link in robot.iter("link"):
        for kind in ("collision", "visual"):
            for shape in link.findall(kind):
                capsule = shape.find("geometry/capsule")
                if capsule is None:
                    continue
                radius, length = capsule.get("radius", ""), float(capsule.get("length", "0"))
                pose = origin_matrix(shape.find("origin"))
                position = list(link).index(shape)
                link.remove(shape)
                for offset, body in ((0.0, "cylinder"), (length / 2, "sphere"), (-length / 2, "sphere")):
                    own = ElementTree.Element(kind)
                    own.append(origin_element(pose @ frame_matrix([0, 0, offset], [0, 0, 0])))
                    extents = {"radius": radius} | ({"length": repr(length)} if body == "cylinder" else {})
                    ElementTree.SubElement(ElementTree.SubElement(own, "geometry"), body, extents)
                    link.insert(position, own)
                    position += 1


def _convert_meshes(robot: ElementTree.Element) -> Iterator[str]:
    """Replace collision meshes in other formats by their convex hulls, and yield those that cannot be read."""
    for mesh in robot.findall("link/collision/geometry/mesh"):
        source = Path(mesh.get("filename", ""))
        if source.suffix.lower() in KNOWN_TO_ALL and not _is_text(source):
            continue
        from pipeline.hand.meshes import read_mesh, write_mesh

        target = generated_mesh(source, source.stem)
        if not target.is_file():
            try:
                hull = read_mesh(source).convex_hull
            except ValueError as error:
                yield f"{error}; give the link shapes of another kind"
                continue
            write_mesh(target, hull.vertices, hull.faces)
        mesh.set("filename", str(target))


def _is_text(file: Path) -> bool:
    """Whether an STL file is of the kind that is text, which MuJoCo does not read."""
    if file.suffix.lower() != ".stl":
        return False
    with file.open("rb") as stream:
        return stream.read(5) == b"solid" and b"facet" in stream.read(400)


def _complete_inertias(robot: ElementTree.Element, density: float) -> None:
    """Give an inertia to links without any, from their shapes; to those that move without a shape, that of a ball."""
    moving = {end_of(joint, "child") for joint in robot.findall("joint") if joint.get("type") != "fixed"}
    for link in robot.findall("link"):
        mass = link.find("inertial/mass")
        if mass is not None and float(mass.get("value", "0")) > 0:
            continue
        collisions = link.findall("collision")
        if not collisions and link.get("name") not in moving:
            continue
        from pipeline.hand.meshes import inertia_of, solid

        found = inertia_of([solid(collision) for collision in collisions], density)
        for old in link.findall("inertial"):
            link.remove(old)
        own = ElementTree.SubElement(link, "inertial")
        T = np.eye(4)
        T[:3, 3] = found.centre
        own.append(origin_element(T))
        ElementTree.SubElement(own, "mass", value=repr(found.mass))
        names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        values = found.about_centre[np.triu_indices(3)].tolist()
        ElementTree.SubElement(own, "inertia", dict(zip(names, map(repr, values), strict=True)))


def origin_element(T: np.ndarray) -> ElementTree.Element:
    """Return the ``<origin>`` of a pose (4, 4)."""
    numbers = (" ".join(map(repr, part.tolist())) for part in (T[:3, 3], rpy_of(T[:3, :3])))
    return ElementTree.Element("origin", dict(zip(("xyz", "rpy"), numbers, strict=True)))
