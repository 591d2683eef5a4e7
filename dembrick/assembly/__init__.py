"""From a scenario to rigid blocks and the joints between them.

``build.assemble`` is the entry point: it turns a ``Scenario`` into an ``Assembly`` with mass properties, joint
polygons, contact points, actuators and loads as arrays. The broad phase, joint detection and the quadrature of joints
are internal; this package knows nothing of time, motion or histories.
"""
