"""
The operations every manifold's kernel answers to.

Each manifold file has one kernel ``apply(op, m, a, b, out, work) -> float`` over flat float64
arrays; ``m`` is the manifold's size parameter, ``work`` scratch of `work_size` numbers: kernels do
not allocate. A *frame* is an isometry from coordinates in Rⁿ to the
tangent space at a point, together with that point: moving it carries it parallel along the motion,
so vectors stored in its coordinates need no transport of their own.

========== ============ ============ ============ ==========================================
op         a            b            out          returns
========== ============ ============ ============ ==========================================
EXP        base point   tangent      point        0
LOG        base point   point        tangent      distance of ``b`` from the cut locus of ``a``
FRAME      point        --           frame        0
POINT      frame        --           point        0
MOVE       frame (i/o)  coordinates  --           0
FRAME_LOG  frame        point        coordinates  distance from the cut locus
VECTOR     frame        coordinates  tangent      0
COORDS     frame        tangent      coordinates  0
MEND       frame (i/o)  --           --           0; removes the rounding of many moves
MEND_POINT point (i/o)  --           --           0; the same for a point
TANGENT    point        vector       tangent      0; projects a vector to the tangent space
========== ============ ============ ============ ==========================================

On the cut locus the logarithms return one of the shortest tangents; what that means is left to the
caller. EXP and FRAME fill ``out`` with NaN where ``a`` is not a point.
"""
EXP, LOG, FRAME, POINT, MOVE, FRAME_LOG, VECTOR, COORDS, MEND, MEND_POINT, TANGENT = range(11)

#: Within this distance [rad] of the cut locus the public logarithm raises.
CUT_LOCUS_LIMIT = 1e-6


def work_size(m: int) -> int:
    """Numbers of scratch that any kernel is content with at size ``m``."""
    return 8 * (m + 1) ** 2
