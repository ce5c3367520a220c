"""The Allegro hand (right): description, kinematics, contact candidates, surface samples and finger moves.

Hand frame: `base_link`; palm normal +x, fingers +z, index side +y.
"""
