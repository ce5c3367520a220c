"""Two-object grasps: thumb, index and middle of a pinch grasp joined with ring and palm of a side grasp."""
