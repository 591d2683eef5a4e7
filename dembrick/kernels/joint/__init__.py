"""The laws of joints, one copy of each, called by both engines: ``kernels.statics`` and ``kernels.dynamics``.

`point_law`: force and memory of a contact point (return mapping of Coulomb friction). `area_law`: the same of a convex
joint (`limit_surface`, `pressure`, `no_tension`). `dashpots`: action of a dashpot in the step in which contact begins.
`utilisation`: how much of its strength a joint uses. The laws take penetrations, slips and memory as floats and return
forces and the new memory; they know nothing of blocks, time steps or the arrays of an engine.

To add a law (cohesion, tension, dilation, crushing: anything that depends on the state of one point only):

1. `scenario.model.JointLaw`: its key, by default absent, and its checks.
2. `point_law`: a function beside the dry one with its additional arguments, and a NamedTuple of arrays for it,
   strengths by joint and memory by point. Joints without it pass None, and numba omits its code: the dry law stays as
   it is.
3. The point family of each engine (`statics.point_joints`, `dynamics.point_joints`): the NamedTuple as a field that may
   be None; the one call of `point_law.point_law`; the memory in `remember`; in `dissipation`, `carried_share`,
   `dead_gauge` and `write_contacts` the strength, where it exceeds mu N.
4. `simulation.statics.point_joints` and `simulation.dynamics.state`: fill the NamedTuple; its memory into `MEMORY`.

The same applies to `area_law` and the modules called ``area_joints`` for convex joints. Only `joint_families` of each
engine distinguishes the families that a scene has, and their laws. `tests/kernels/test_one_law.py` checks that both
engines agree; add states of the new law there.
"""
