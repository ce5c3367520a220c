"""Which parameters and metrics differ between two results: commits, branches, experiments, or the files as they are.

python examples/08_compare_experiments.py [BEFORE [AFTER]]
"""

import sys

import seqgrasp

before, after = [*sys.argv[1:], "HEAD", None][:2] if len(sys.argv) < 3 else sys.argv[1:3]
difference = seqgrasp.compare_experiments(before, after)
print(f"{before} and {after or 'the working folder'} differ in {len(difference)} parameters and metrics")
if not difference.empty:
    print(difference.to_string())
