"""Rates per object and per pair as small tables, which `dvc plots` draws and git keeps."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

SURVIVAL = re.compile(r"validate\.(\w+)\.(\w+)\.survival_rate")
SUCCESS = re.compile(r"evaluate\.(\w+)\.(\w+)--(\w+)\.success_rate")
# Where there are too many objects or pairs for keys of their own.
SURVIVAL_SPREAD = re.compile(r"validate\.(\w+)\.survival_rate_(quartile_1|median|quartile_3)")
SUCCESS_SPREAD = re.compile(r"evaluate\.(\w+)\.success_rate_(quartile_1|median|quartile_3)")
CONDITION_SUCCESS = re.compile(r"evaluate\.conditions\.([\w.]+)\.(\w+)--(\w+)\.success_rate")


def survival_rows(summary: Mapping[str, Any]) -> list[tuple[str, float]]:
    """Return (object, share of its chains that physics accepts), such as ``("cube, pinch", 0.755)``, sorted.

    Of many objects there are quartiles, such as ``("median, pinch", 0.755)``.
    """
    rows = []
    for key, value in summary.items():
        if match := SURVIVAL.fullmatch(key) or SURVIVAL_SPREAD.fullmatch(key):
            rows.append((f"{match[2]}, {match[1]}", float(value)))
    return sorted(rows)


def success_rows(summary: Mapping[str, Any]) -> list[tuple[str, float]]:
    """Return (pair, share of its trials that lift both objects), such as ``("cube, can: learned", 1.0)``, sorted.

    Of many pairs there are quartiles, such as ``("median: learned", 1.0)``.
    """
    rows = []
    for key, value in summary.items():
        if match := SUCCESS_SPREAD.fullmatch(key):
            rows.append((f"{match[2]}: {match[1]}", float(value)))
        if match := SUCCESS.fullmatch(key) or CONDITION_SUCCESS.fullmatch(key):
            rows.append((f"{match[2]}, {match[3]}: {match[1].replace('.', ', ')}", float(value)))
    return sorted(rows)


def csv_text(header: str, rows: list[tuple[str, float]]) -> str:
    """Return the table as text; names hold commas, and are quoted."""
    return "".join([f"{header},rate\n", *(f'"{name}",{rate}\n' for name, rate in rows)])
