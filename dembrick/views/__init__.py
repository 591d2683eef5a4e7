"""Views of a run: motion of blocks and joints, plots, pictures, the web page, exports.

A ``History`` goes in; figures, images, text and files for ParaView come out. Views never run anything: they import
nothing from ``runs``.
"""
