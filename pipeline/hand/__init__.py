"""Hands: their descriptions as arrays, kinematics, contact candidates, surface samples and finger moves.

A hand frame is that of the root link; the Allegro's `base_link` has palm normal +x, fingers +z, index side +y.
"""
