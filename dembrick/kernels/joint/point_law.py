"""The law of a contact point: a no-tension normal spring and Coulomb friction, each spring with a dashpot beside it.

Both engines call `point_law` once a point and step. Sign of all shear quantities: the action on block b (in dynamics
the host), which is also the direction in which it slips; the joint pushes back with the opposite.

- Normal: N = k_n (g + viscous d'), never negative and zero if g <= 0; d' is `onset.dashpot_growth`.
- Shear: spring and dashpot in parallel, both behind a slider of strength mu N. The trial force is the elastic force
  before plus k_s (1 + viscous) times the slip of the step; beyond mu N it returns along its own direction.
- Memory: the elastic shear force, in N. An open point (N = 0) carries nothing and remembers nothing: a point that
  closes again begins without shear. (A decay over the dashpot's time instead, k_s / c, would let the regularisation
  decide what a joint remembers; as the dashpot gets smaller it tends to this rule.)
- `slip` is the irreversible part of the shear displacement, as a path length: the plastic increment of each step added
  up while the point is closed. What an open point moves past is no slip.

The code has no branches, so that a loop over the lanes of a tile becomes wide instructions.
"""

from math import sqrt

from dembrick._jit import jit
from dembrick.kernels.joint.onset import dashpot_growth

NONE = 1e-140  # as good as zero, in a divisor


@jit
def coulomb(elastic_1, elastic_2, slip_1, slip_2, k, damped, share, cap):
    """Return mapping of Coulomb friction at a point, radial, spring and dashpot in parallel behind the slider.

    ``slip_*``: increment of the relative displacement (m); ``k`` N/m; ``damped``: one plus dashpot force over spring
    force for the same increment; ``share``: one over that; ``cap`` = mu N (N). Returns the shear force (2), the elastic
    part of it that stays (2) and the length of the plastic increment (m), which points along the force.
    """
    t1 = elastic_1 + damped * k * slip_1
    t2 = elastic_2 + damped * k * slip_2
    size2 = t1 * t1 + t2 * t2
    # one over size and one over the stiffness by one division; nothing slides if they are zero
    size = sqrt(max(size2, NONE))
    divisor = max(k, NONE)
    both = 1.0 / (size * divisor)
    kept = cap * divisor * both if size2 > cap * cap else 1.0
    plastic = (1.0 - kept) * share * size * size * both
    t1 *= kept
    t2 *= kept
    e1 = elastic_1 + share * (t1 - elastic_1)
    e2 = elastic_2 + share * (t2 - elastic_2)
    return t1, t2, e1, e2, plastic


@jit
def point_law(g, d, slip_1, slip_2, elastic_1, elastic_2, k_n, k_s, friction, viscous, damped, share):
    """Force of a contact point and its new memory, dry.

    ``g`` penetration now and ``d`` its growth in the step (m); ``slip_*`` of the step (m); ``elastic_*`` memory (N);
    ``k_n``, ``k_s`` N/m; ``viscous``: dashpot over spring force along the normal, ``damped`` one plus that in shear,
    ``share`` one over that. Returns N, the shear force (2), the new memory (2) and the slip path of the step (m).
    """
    h = k_n * (g + viscous * dashpot_growth(g, d))
    h = h if g > 0.0 else 0.0
    normal = h if h > 0.0 else 0.0
    closed = 1.0 if h > 0.0 else 0.0
    t1, t2, e1, e2, slid = coulomb(elastic_1, elastic_2, slip_1, slip_2, k_s, damped, share, friction * normal)
    return normal, t1, t2, closed * e1, closed * e2, closed * slid


@jit
def shear_loss(before_1, before_2, after_1, after_2, slip_1, slip_2, k):
    """What the shear spring of a point does not give back of the work of a step (J): friction, or released.

    A spring that was loaded from e to e' while the point moved by s took (e + e') s / 2 and holds (e'^2 - e^2) / 2k
    more. The rest went into friction, or was let go if the point has opened.
    """
    divisor = max(k, NONE)
    q1 = k * slip_1 - (after_1 - before_1)
    q2 = k * slip_2 - (after_2 - before_2)
    return 0.5 * ((before_1 + after_1) * q1 + (before_2 + after_2) * q2) / divisor
