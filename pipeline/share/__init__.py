"""What others take from a finished run: grasps as a table or in the released code's format. No stage imports this."""

from pipeline.share.columns import GRASP_COLUMNS
from pipeline.share.grasps import load_grasps

__all__ = ["GRASP_COLUMNS", "load_grasps"]
