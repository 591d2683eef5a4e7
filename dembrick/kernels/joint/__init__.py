"""Laws of a joint, one of each, called by both engines: ``kernels.statics`` and ``kernels.dynamics``.

`point_law`: force and memory of a contact point (return mapping of Coulomb friction). `area_law`: the same of a convex
joint (`limit_surface`, `pressure`, `no_tension`). `dashpots`: what a dashpot does in the step in which contact begins.
`utilisation`: how much of its strength a joint uses. In go penetrations, slips and memory as floats, out come forces
and the new memory; nothing here knows blocks, steps of a loop or arrays of an engine.

How a law is added (cohesion, tension, dilation, crushing: any that a point decides by itself):

1. `scenario.model.JointLaw`: its key with a default of none, and its checks.
2. `point_law`: a function beside the dry one with what it needs more, and a NamedTuple of arrays for it, strengths
   by joint and memory by point. What has none passes None, and numba leaves the code out: the dry law stays as it is.
3. The point family of each engine (`statics.point_joints`, `dynamics.point_joints`): the NamedTuple as a field that may
   be None; the one call of `point_law.point_law`; the memory in `remember`; in `dissipation`,
   `carried_share`, `dead_gauge` and `write_contacts` the strength, where it is more than mu N.
4. `simulation.statics.point_joints` and `simulation.dynamics.state`: fill the NamedTuple; its memory into `MEMORY`.

The same with `area_law` and the modules called ``area_joints`` for convex joints. No other module asks which families a
scene has or what their laws are: `joint_families` of either engine does. `tests/kernels/test_one_law.py` holds the
engines together; add the law's states there.
"""
