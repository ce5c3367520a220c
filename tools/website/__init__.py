"""The documentation as a site of pages (mkdocs): what is made of README.md, of links out of docs/, and of the code.

``./dev docs`` builds it with the settings of ``mkdocs.yml``. No stage imports this room.
"""
