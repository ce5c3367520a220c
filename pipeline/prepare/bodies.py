"""Which of several separate bodies in a mesh become the object."""

from __future__ import annotations

from typing import Any

import manifold3d

from pipeline.records.errors import UserError

SPECK = 1e-3  # of the volume; smaller separate bodies are scan noise


def chosen_bodies(manifold: Any, bodies: str | int, repairs: list[str], name: str) -> Any:
    """Return the bodies that are wanted, without specks.

    Args:
        manifold: a closed solid of one or more bodies.
        bodies: ``refuse``, ``largest``, ``all``, or the number of one body, the largest being 1.

    Raises:
        UserError: there are several bodies of notable size and none is chosen, or the chosen one does not exist.
    """
    # A filled body has positive volume; a negative one would be a cavity that union left, which it never does.
    found = sorted(manifold.decompose(), key=lambda body: -body.volume())
    large = [body for body in found if body.volume() > SPECK * manifold.volume()]
    if not large:
        raise UserError(f"{name}: the mesh encloses no volume; model it as a solid.")
    if len(large) > 1 and bodies == "refuse":
        shares = ", ".join(f"{body.volume() / manifold.volume():.0%}" for body in large[:4])
        raise UserError(
            f"{name}: the mesh holds {len(large)} separate bodies ({shares}{', ...' if len(large) > 4 else ''} of the "
            "volume); set `bodies` to largest, to the number of one (1 is the largest), or to all for one rigid object."
        )
    if isinstance(bodies, int) and bodies > len(large):
        raise UserError(f"{name}: there is no body {bodies}, the mesh holds {len(large)}; correct `bodies`.")
    if len(found) > len(large):
        repairs.append(f"dropped {len(found) - len(large)} specks below {SPECK:.1%} of the volume")
    if len(large) == 1:
        return large[0]
    if bodies == "all":
        repairs.append(f"kept {len(large)} separate bodies as one rigid object")
        return manifold3d.Manifold.compose(large)
    number = bodies if isinstance(bodies, int) else 1
    repairs.append(f"kept body {number} of {len(large)}, {large[number - 1].volume() / manifold.volume():.0%} of all")
    return large[number - 1]


def body_count(manifold: Any) -> int:
    """Return how many bodies of notable size a solid has."""
    return sum(body.volume() > SPECK * manifold.volume() for body in manifold.decompose())
