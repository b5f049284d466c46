// The last step of a node, `at` places from the first one, around which is `x`, and its part of the sums.
.macro step at, k
    lw {p}, 8 * (\at)({own})
    lw {rhs}, 8 * (\at) + 4({own})
    andi {y}, \k, 7
    mul {y}, {y}, {p}
    sub {x}, {x}, {y}
    slli {x}, {x}, 2
    add {x}, {x}, {rhs}
    mulh {q}, {x}, \k
    add {q}, {p}, {q}
    // The upper limit, the lower one, and rounding.
    srai {y}, {q}, 31
    and {q}, {q}, {y}
    add {rhs}, {q}, {room}
    srai {y}, {rhs}, 31
    and {rhs}, {rhs}, {y}
    sub {q}, {q}, {rhs}
    ori {q}, {q}, 1
    sw {q}, 8 * (\at)({own})
    // 8 r of the new piston: less by its degree times what it has moved.
    sub {p}, {q}, {p}
    andi {y}, \k, 7
    mul {p}, {p}, {y}
    slli {p}, {p}, 2
    sub {x}, {x}, {p}
    total {x}, {q}, {y}, {p}
.endm
