"""From a scenario to rigid blocks and the joints between them.

``build.assemble`` is the entrance: a ``Scenario`` goes in, an ``Assembly`` comes out, with mass properties, joint
polygons, contact points, actuators and loads as arrays. Hidden here are the broad phase, joint detection and the
quadrature of joints; nothing here knows of time, forces or files.
"""
