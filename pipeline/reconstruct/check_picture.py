"""One picture of a capture before the long work: where cameras, tags and boxes are, and who sees what."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from pipeline.reconstruct.cameras import PosedPhoto
from pipeline.reconstruct.coverage import LARGEST_GAP, SIDEWAYS, Looks, box_pixels, centre_of, gap_around
from pipeline.reconstruct.detection import Seen
from pipeline.records.captures import Scene
from pipeline.records.tag_layouts import TagLayout

MOST_RINGS = 4  # objects whose ring is drawn
FRUSTUM = 0.15  # of a camera's distance: so long is it drawn
AZIMUTHS, HEIGHTS = np.linspace(0, 360, 25), np.linspace(0, 90, 7)  # degrees: edges of a ring's cells
EDGES = ((0, 1), (0, 2), (0, 4), (1, 3), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 6), (5, 7), (6, 7))
BOX_COLOURS = ("#e67e22", "#3484c4", "#279a6e", "#9e56b0", "#c84650", "#968c28")
TAG_COLOUR, GAP_COLOUR = "#00c853", "#d32f2f"


@dataclass(frozen=True)
class Shown:
    """What is drawn of a capture."""

    scene: Scene
    layout: TagLayout  # where the tags lie, as given or as found
    posed: Sequence[PosedPhoto]
    seen: Mapping[str, Seen]  # per photo
    looks: Mapping[str, Looks]  # per object


def frustum(view: PosedPhoto, length: float) -> NDArray[np.float64]:
    """Return the tip of a camera's frustum and the corners of its base (5, 3), scene frame; ``length`` in m."""
    width, height = view.photo.size
    x, y = width / 2 / view.lens.focal, height / 2 / view.lens.focal
    local = length * np.array([[0, 0, 0], [-x, -y, 1], [x, -y, 1], [x, y, 1], [-x, y, 1]])
    T = view.T_camera_scene
    return np.asarray((local - T[:3, 3]) @ T[:3, :3])


def _colour(index: int) -> str:
    return BOX_COLOURS[index % len(BOX_COLOURS)]


def _from_one_side(axes: Any, shown: Shown, second: int, colours: ScalarMappable) -> None:
    """Draw cameras, tags and boxes; x to the right, upwards the coordinate ``second``: 1 from above, 2 from -y."""
    plane = [0, second]
    for places in shown.layout.corners().values():
        axes.add_patch(Polygon(places[:, plane], closed=True, facecolor="#404040", edgecolor="#404040", linewidth=1))
    for index, (name, item) in enumerate(shown.scene.objects.items()):
        corners = item.corners(shown.scene.support_plane, 0.0)[:, plane]
        for one, other in EDGES:
            axes.plot(*corners[[one, other]].T, color=_colour(index), linewidth=1.5)
        axes.annotate(name, corners.mean(axis=0), color=_colour(index), ha="center", va="center", weight="bold")
    target = np.mean([[*item.position, shown.scene.support_plane] for item in shown.scene.objects.values()], axis=0)
    for view in shown.posed:
        distance = float(np.linalg.norm(centre_of(view.T_camera_scene) - target))
        points = frustum(view, FRUSTUM * distance)[:, plane]
        colour = colours.to_rgba(np.array([len(shown.seen[view.photo.name].tags)]))[0]
        for one, other in ((1, 2), (2, 3), (3, 4), (4, 1)):
            axes.add_patch(
                Polygon(points[[0, one, other]], closed=True, facecolor=(*colour[:3], 0.25), edgecolor=colour)
            )
    if second == 2:
        axes.axhline(shown.scene.support_plane, color="#909090", linewidth=0.8)
    axes.autoscale_view()
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]" if second == 1 else "z [m]")
    axes.set_title("from above" if second == 1 else "from the side (from -y)")
    axes.grid(color="#e8e8e8")
    axes.set_axisbelow(True)


def _ring(axes: Any, name: str, colour: str, looks: Looks) -> None:
    """Draw how often an object is seen from each direction: azimuth around, the zenith in the middle."""
    counts, _, _ = np.histogram2d(looks.azimuths, np.clip(looks.heights, 0, 89.9), bins=(AZIMUTHS, HEIGHTS))
    cells = np.ma.masked_equal(counts.T, 0)
    axes.pcolormesh(np.radians(AZIMUTHS), 90 - HEIGHTS, cells, cmap="YlGn", vmin=0, vmax=max(3, counts.max()))
    axes.plot(np.radians(looks.azimuths), 90 - np.clip(looks.heights, 0, 90), "o", color="black", markersize=3)
    begin, width = gap_around(looks)
    if width > LARGEST_GAP:
        along = np.radians(np.linspace(begin, begin + width, 100))
        axes.fill_between(along, 90 - SIDEWAYS, 90, color=GAP_COLOUR, alpha=0.15, linewidth=0)
        axes.plot(along, np.full(100, 89.0), color=GAP_COLOUR, linewidth=4)
    axes.set_ylim(0, 90)
    axes.set_yticks([30, 60, 90], ["60", "30", "0"], fontsize=7, color="#606060")
    axes.set_xticks(np.radians([0, 90, 180, 270]), ["+x", "+y", "-x", "-y"], fontsize=8)
    gap = f", {width:.0f} degrees without" if width > LARGEST_GAP else ""
    axes.set_title(f"{name}: {len(looks.names)} photos{gap}", color=colour, fontsize=10)


def shown_best(names: Sequence[str], posed: Sequence[PosedPhoto], seen: Mapping[str, Seen]) -> str:
    """Return the photo to draw: of those posed, else of all ``names``, the first with the most tags."""
    candidates = [view.photo.name for view in posed] or list(names)
    return max(candidates, key=lambda name: len(seen[name].tags))


def _photo(axes: Any, shown: Shown, name: str, colours: NDArray[np.uint8]) -> None:
    """Draw a photo (h, w, 3), the tags found in it, and the boxes as its camera sees them."""
    height, width = colours.shape[:2]
    axes.imshow(colours, extent=(0, width, height, 0), interpolation="antialiased")
    for number, corners in shown.seen[name].tags.items():
        axes.add_patch(Polygon(corners, closed=True, fill=False, edgecolor=TAG_COLOUR, linewidth=1.2))
        axes.annotate(str(number), corners.mean(axis=0), color=TAG_COLOUR, fontsize=6, ha="center", va="center")
    for view in shown.posed:
        if view.photo.name != name:
            continue
        for index, (label, item) in enumerate(shown.scene.objects.items()):
            pixels = box_pixels(item, shown.scene.support_plane, view)
            if pixels is None:
                continue
            for one, other in EDGES:
                axes.plot(*pixels[[one, other]].T, color=_colour(index), linewidth=1.8)
            at, style = pixels[pixels[:, 1].argmin()], {"color": _colour(index), "ha": "center", "weight": "bold"}
            axes.annotate(label, at, (0, 4), textcoords="offset points", **style)
    axes.set(xlim=(0, width), ylim=(height, 0))
    axes.set_axis_off()
    axes.set_title(f"{name}: {len(shown.seen[name].tags)} tags found")


def check_picture(shown: Shown, name: str, colours: NDArray[np.uint8]) -> bytes:
    """Return the picture as PNG.

    Args:
        name: of the photo that is drawn.
        colours: (h, w, 3) that photo, at the size worked with.
    """
    rings = list(shown.looks)[:MOST_RINGS]
    with matplotlib.rc_context({"font.size": 9}):
        figure = Figure(figsize=(15, 10.5), dpi=100, layout="constrained")
        FigureCanvasAgg(figure)
        rows = figure.add_gridspec(2, 1, height_ratios=(1, 1.2))
        upper = rows[0].subgridspec(1, 2)
        most = max([len(its.tags) for its in shown.seen.values()], default=0)
        scale = ScalarMappable(Normalize(0, max(most, 2)), "viridis")
        sides = [figure.add_subplot(upper[0]), figure.add_subplot(upper[1])]
        for axes, second in zip(sides, (1, 2), strict=True):
            _from_one_side(axes, shown, second, scale)
        figure.colorbar(scale, ax=sides, label="tags in the photo", shrink=0.8)
        lower = rows[1].subgridspec(1, 2, width_ratios=(1, 1.2))
        columns = 1 if len(rings) == 1 else 2
        places = lower[0].subgridspec(-(-len(rings) // columns), columns)
        for index, ring in enumerate(rings):
            axes = figure.add_subplot(places[index // columns, index % columns], projection="polar")
            _ring(axes, ring, _colour(index), shown.looks[ring])
        _photo(figure.add_subplot(lower[1]), shown, name, colours)
        figure.suptitle(
            "Rings: from where each object is seen; a dot per photo, azimuth around, degrees above the support inwards"
        )
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()
