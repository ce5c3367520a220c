"""Stage merge: two-object grasps from validated single grasps."""
