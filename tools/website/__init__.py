"""The documentation site (mkdocs): what is generated from README.md, from links out of docs/, and from the code.

``./dev docs`` builds it with the settings of ``mkdocs.yml``. No stage imports this room.
"""
