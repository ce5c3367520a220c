"""Stage merge: single grasps of several objects joined in one hand, each with fingers of its own."""
