"""A made-up hand of a thumb and four fingers, whose index and little finger have a last joint that follows another.

Hand frame: palm normal +x, stretched fingers +z, the thumb on the side of +y.
"""

from __future__ import annotations

from math import pi

PLACES = {"index": 0.048, "middle": 0.016, "ring": -0.016, "little": -0.048}  # m, along y
LENGTHS = (0.05, 0.035, 0.03)  # m, of the phalanges
FOLLOWING = ("index", "little")
WIDTH = 0.018  # m


def _box(size: tuple[float, ...], centre: tuple[float, ...]) -> str:
    numbers = [" ".join(f"{value:g}" for value in values) for values in (centre, size)]
    return f'<collision><origin xyz="{numbers[0]}"/><geometry><box size="{numbers[1]}"/></geometry></collision>'


def _phalanges(finger: str, parent: str, place: str, joints: tuple[tuple[str, str, float, float], ...]) -> str:
    """Joints of a finger, (name, axis, lower, upper), and a phalanx after each; the first only turns the thumb."""
    text, lengths = "", (0.0, *LENGTHS)[-len(joints) :]
    for number, ((name, axis, lower, upper), length) in enumerate(zip(joints, lengths, strict=True)):
        last = number == len(joints) - 1
        link = f"{finger}_tip" if last else f"{finger}_{number}"
        follows = f'<mimic joint="{finger}_{joints[number - 1][0]}" multiplier="0.8"/>'
        mimic = follows if last and finger in FOLLOWING else ""
        end = f'<origin xyz="0 0 {length - 0.004:g}"/>'
        ball = f'<collision>{end}<geometry><sphere radius="0.011"/></geometry></collision>'
        shapes = _box((WIDTH, WIDTH, length - 0.006), (0.0, 0.0, length / 2)) if length else ""
        text += f"""
          <joint name="{finger}_{name}" type="revolute">
            <parent link="{parent}"/><child link="{link}"/>{place}<axis xyz="{axis}"/>
            <limit lower="{lower}" upper="{upper}" effort="5" velocity="5"/>{mimic}
          </joint>
          <link name="{link}">{shapes}{ball if last else ""}</link>"""
        parent, place = link, f'<origin xyz="0 0 {length:g}"/>'
    return text


def urdf_text() -> str:
    """Return the URDF."""
    bends = (("knuckle", "0 1 0", -0.2, 1.6), ("middle_joint", "0 1 0", 0.0, 1.7), ("end_joint", "0 1 0", 0.0, 1.4))
    fingers = "".join(_phalanges(name, "palm", f'<origin xyz="0 {y} 0"/>', bends) for name, y in PLACES.items())
    thumb = _phalanges(
        "thumb",
        "palm",
        f'<origin xyz="0 0.055 -0.06" rpy="{-pi / 2} 0 0"/>',
        (
            ("turn", "0 1 0", 0.0, 1.7),
            ("knuckle", "1 0 0", -0.3, 1.3),
            ("middle_joint", "1 0 0", 0.0, 1.4),
            ("end_joint", "1 0 0", 0.0, 1.4),
        ),
    )
    palm = _box((0.024, 0.125, 0.1), (0.0, 0.0, -0.055))
    return f'<robot name="five"><link name="palm">{palm}</link>{fingers}{thumb}</robot>'
