"""Views of a run: motion of blocks and joints, plots, pictures, the web page, exports.

Views turn a ``History`` into figures, images, text and files for ParaView. They never run a simulation and import
nothing from ``runs``.
"""
