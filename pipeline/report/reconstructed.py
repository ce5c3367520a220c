"""Objects from photos: how well cameras, scale and surfaces were found, and what they look like."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from typing import Any

from pipeline.records.reconstructions import load_reconstruction_metrics, load_reconstruction_pictures
from pipeline.report.charts import image, percent, table

KINDS = {"rendered": "rendered by computer", "photos": "photos"}
METHODS = {"plane_sweep": "plane sweep and Poisson", "2dgs": "2D Gaussian splatting"}
UNKNOWN = "–"


@dataclass(frozen=True)
class Reconstructed:
    """What ``reconstruct`` left behind of one capture."""

    metrics: Mapping[str, Any]  # metrics.json
    pictures: Mapping[str, tuple[bytes, bytes]]  # per photo shown, itself and what was found, JPEG


def load_reconstructed(captures: Iterable[str]) -> dict[str, Reconstructed]:
    """Read figures and pictures of all captures.

    Raises:
        UserError: a file is missing or damaged.
    """
    return {
        name: Reconstructed(load_reconstruction_metrics(name), load_reconstruction_pictures(name)) for name in captures
    }


def reconstructed_summary(capture: str, metrics: Mapping[str, Any]) -> dict[str, float | int]:
    """Return one capture's part of the summary."""
    keys = ("registered_ratio", "reprojection_px", "alignment_mm", "camera_mm_mean", "chamfer_mm_max")
    values = {f"reconstruct.{capture}.{key}": metrics[key] for key in keys if key in metrics}
    for name, figures in metrics["objects"].items():
        if "chamfer_mm" in figures:
            values[f"reconstruct.{capture}.{name}.chamfer_mm"] = figures["chamfer_mm"]
    return values


def _figure(metrics: Mapping[str, Any], key: str, digits: int = 2) -> str:
    return f"{metrics[key]:.{digits}f}" if key in metrics else UNKNOWN


def _cameras_table(found: Mapping[str, Reconstructed]) -> str:
    rows = []
    for capture, one in found.items():
        own = one.metrics
        rows.append(
            [capture.replace("_", " "), KINDS[own["kind"]], METHODS[own["method"]]]
            + [f"{own['registered']} of {own['photos']}", _figure(own, "reprojection_px")]
            + [str(own["tags_located"]), _figure(own, "alignment_mm"), _figure(own, "camera_mm_mean")]
        )
    headers = ["capture", "pictures", "surface by", "cameras found", "reprojection error (px)"]
    headers += ["tags located", "tags off their layout (mm)", "cameras off the truth (mm)"]
    return table(headers, rows)


def _objects_table(found: Mapping[str, Reconstructed]) -> str:
    rows = []
    for capture, one in found.items():
        for name, own in one.metrics["objects"].items():
            rows.append(
                [f"{name} ({capture})".replace("_", " "), str(own["points"]), percent(own["seen_share"])]
                + [f"{own['volume_cm3']:.0f}"]
                + [_figure(own, key) for key in ("chamfer_mm", "accuracy_mm", "completeness_mm")]
                + [percent(own["f_score_2mm"]) if "f_score_2mm" in own else UNKNOWN]
            )
    headers = ["object (capture)", "points measured", "of the surface seen", "volume (cm³)"]
    headers += ["chamfer (mm)", "found to true (mm)", "true to found (mm)", "F-score at 2 mm"]
    return table(headers, rows)


def _shape(picture: bytes) -> tuple[int, int]:
    from PIL import Image

    return Image.open(io.BytesIO(picture)).size


def _pictures(capture: str, one: Reconstructed) -> str:
    figures = "".join(
        f"<figure>{image(picture, f'{photo}: {what}', _shape(picture))}"
        f"<figcaption>{escape(f'{photo}: {what}')}</figcaption></figure>"
        for photo, both in one.pictures.items()
        for what, picture in zip(("as taken", "what was found"), both, strict=True)
    )
    return f"<h3>{escape(capture.replace('_', ' '))}</h3>\n" + f'<div class="strip photos">{figures}</div>\n'


def reconstructed_section(found: Mapping[str, Reconstructed]) -> str:
    """Return figures of cameras and of objects, and some photos beside what was found."""
    return (
        "<p>From a folder of photos with AprilTags in view: camera poses by feature matching, frame and scale from the "
        "tags, a closed surface and a point cloud of every object. How to take photos: <code>docs/capture.md</code>."
        "</p>\n"
        f"{_cameras_table(found)}"
        "<p>Reprojection: mean distance of features from where their points are seen. Tags: root mean square distance "
        "of their corners from where <code>tags.yaml</code> has them.</p>\n"
        f"{_objects_table(found)}"
        "<p>Distances are means over the whole closed surfaces, undersides included, which no photo shows; chamfer is "
        "the mean of both directions. They are known only where the capture brings the true surfaces. In the pictures "
        "every object has a colour; what is grey was assumed, not measured.</p>\n"
        + "".join(_pictures(capture, one) for capture, one in found.items())
    )
