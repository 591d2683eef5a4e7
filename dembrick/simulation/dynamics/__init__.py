"""Motion in real time: true mass, exact rotations, joints that open and slide, contacts that form.

An ``Assembly`` and a control that lives in time go in; what comes out is a record of the motion and how it ended.
"""
