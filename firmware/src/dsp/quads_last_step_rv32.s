// The last step of a node, `at` places from the first one, around which is `x`, and its part of the sums.
.macro step at, k
    residual \at, \k
    mulh {q}, {x}, \k
    add {q}, {p}, {q}
    limit {q}, {rhs}, {y}
    sw {q}, 8 * (\at)({own})
    // 8 r of the new piston: less by its degree times what it has moved.
    sub {p}, {q}, {p}
    andi {y}, \k, 7
    mul {p}, {p}, {y}
    slli {p}, {p}, 2
    sub {x}, {x}, {p}
    total {x}, {q}, {y}, {p}
.endm
