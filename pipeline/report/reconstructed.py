"""Objects from photos: how well cameras, scale and surfaces were found, and what they look like."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup
from PIL import Image

from pipeline.records.reconstructions import load_reconstruction_metrics, load_reconstruction_pictures
from pipeline.report.charts import Table
from pipeline.report.rendering import render
from pipeline.report.wording import UNKNOWN, percent, spoken

KINDS = {"rendered": "synthetic", "photos": "photos"}
METHODS = {"plane_sweep": "plane sweep and Poisson", "2dgs": "2D Gaussian splatting"}


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


def _cameras_table(found: Mapping[str, Reconstructed]) -> Table:
    rows = []
    for capture, one in found.items():
        own = one.metrics
        rows.append(
            [spoken(capture), KINDS[own["kind"]], METHODS[own["method"]]]
            + [f"{own['registered']} of {own['photos']}", _figure(own, "reprojection_px")]
            + [str(own["tags_located"]), _figure(own, "alignment_mm"), _figure(own, "camera_mm_mean")]
        )
    headers = ["capture", "pictures", "surface by", "cameras found", "reprojection error (px)"]
    headers += ["tags located", "tag error (mm)", "camera error (mm)"]
    return Table(headers, rows)


def _objects_table(found: Mapping[str, Reconstructed]) -> Table:
    rows = []
    for capture, one in found.items():
        for name, own in one.metrics["objects"].items():
            rows.append(
                [spoken(f"{name} ({capture})"), str(own["points"]), percent(own["seen_share"])]
                + [f"{own['volume_cm3']:.0f}"]
                + [_figure(own, key) for key in ("chamfer_mm", "accuracy_mm", "completeness_mm")]
                + [percent(own["f_score_2mm"]) if "f_score_2mm" in own else UNKNOWN]
            )
    headers = ["object (capture)", "points measured", "surface seen", "volume (cm³)"]
    headers += ["chamfer (mm)", "found to true (mm)", "true to found (mm)", "F-score at 2 mm"]
    return Table(headers, rows)


def _shape(picture: bytes) -> tuple[int, int]:

    return Image.open(io.BytesIO(picture)).size


def reconstructed_section(found: Mapping[str, Reconstructed]) -> Markup:
    """Return figures of cameras and of objects, and some photos, each beside what was found."""
    pictures = {
        capture: [
            (picture, f"{photo}: {what}", _shape(picture))
            for photo, both in one.pictures.items()
            for what, picture in zip(("as taken", "reconstruction"), both, strict=True)
        ]
        for capture, one in found.items()
    }
    return render("photos.html", cameras=_cameras_table(found), objects=_objects_table(found), pictures=pictures)
