"""Scalar-lane arithmetic: the one reason this package is fast.

XLA runs a kinematic function fast when it is one fused elementwise loop over the batch, and slowly
when it is thousands of small matrix products, gathers and concatenations. So every formula here is
written on *lanes*: a `Lane` is one scalar of the formula, over the whole batch, or a number that
is known while tracing. Sums with a known zero and products with a known zero or one are folded on
the spot, so a robot whose axes are mostly zeros costs only what is left.

A vector or a matrix of lanes is a numpy array of dtype object: `R @ p`, `a - b`, `J.T` read like
the textbook, and numpy drives the arithmetic element by element while JAX traces.
"""

from niryo_jax.lanes.linalg import (
    adjugate,
    cross,
    dot,
    hat,
    identity,
    norm,
    orthogonalise,
    outer,
    solve,
    trace,
    vee,
    volume,
)
from niryo_jax.lanes.records import RecordRows, astype
from niryo_jax.lanes.scalar import (
    Condition,
    Lane,
    Lanes,
    as_lane,
    choose,
    contiguous_lanes,
    kept_truth,
    lanes_of,
    map_lanes,
    materialise,
    materialised,
    maximum,
    minimum,
    pack,
    reciprocal_root,
    select,
    sqrt,
    unpack,
)
from niryo_jax.lanes.trigonometry import acos, asin, atan2, sincos

__all__ = [
    "Condition",
    "Lane",
    "Lanes",
    "RecordRows",
    "acos",
    "adjugate",
    "as_lane",
    "asin",
    "astype",
    "atan2",
    "choose",
    "contiguous_lanes",
    "cross",
    "dot",
    "hat",
    "identity",
    "kept_truth",
    "lanes_of",
    "map_lanes",
    "materialise",
    "materialised",
    "maximum",
    "minimum",
    "norm",
    "orthogonalise",
    "outer",
    "pack",
    "reciprocal_root",
    "select",
    "sincos",
    "solve",
    "sqrt",
    "trace",
    "unpack",
    "vee",
    "volume",
]
