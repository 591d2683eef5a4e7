"""Motion in real time: true mass, exact rotations, joints that open and slide, contacts that form.

Input are an ``Assembly`` and a control in real time; output are a record of the motion and its outcome.
"""
