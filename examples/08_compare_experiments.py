"""Which parameters and metrics differ between two results: commits, branches, experiments, or the files as they are.

python examples/08_compare_experiments.py [BEFORE [AFTER]]
"""

import sys

import seqgrasp

before = sys.argv[1] if len(sys.argv) > 1 else "HEAD"
after = sys.argv[2] if len(sys.argv) > 2 else None  # the files as they are
difference = seqgrasp.compare_experiments(before, after)
print(f"{before} and {after or 'the working folder'} differ in {len(difference)} parameters and metrics")
if not difference.empty:
    print(difference.to_string())
