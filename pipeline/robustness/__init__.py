"""How well a grasp holds: margins by linear programs, the lowest friction, and the share of conditions it survives."""
