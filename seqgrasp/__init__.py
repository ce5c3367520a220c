"""Sequential multi-object grasping from Python: load, prepare, synthesize, score, sample, rerun and compare.

Lengths are metres, angles radians, quaternions w, x, y, z; ``T_a_b`` maps coordinates in frame b to frame a. An
object's frame has its origin at the centre of mass and z up as the object stands; a hand's frame is that of its root
link. Relative paths, and ``params.yaml``, ``data/`` and ``models/``, are those of the working folder: start in a clone.
"""

from pipeline.hand.model import load_hand
from pipeline.records.errors import UserError
from pipeline.records.objects import PreparedObject
from pipeline.records.objects import load_prepared_object as load_object
from pipeline.records.parameters import Parameters, read_parameters
from pipeline.share import GRASP_COLUMNS, load_grasps
from seqgrasp.experiments import compare_experiments
from seqgrasp.grasps import candidates_of, sample_grasps, synthesize, validate
from seqgrasp.objects import prepare_mesh, read_mesh
from seqgrasp.trials import Rerun, rerun_trial

__all__ = [
    "GRASP_COLUMNS",
    "Parameters",
    "PreparedObject",
    "Rerun",
    "UserError",
    "candidates_of",
    "compare_experiments",
    "load_grasps",
    "load_hand",
    "load_object",
    "prepare_mesh",
    "read_mesh",
    "read_parameters",
    "rerun_trial",
    "sample_grasps",
    "synthesize",
    "validate",
]
