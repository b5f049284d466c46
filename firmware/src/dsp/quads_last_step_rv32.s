// The last step of a node, `at` places from the first one, around which is `x`, and its part of the sums.
.macro step at, k
    lw {rhs}, 8 * (\at) + 4({own})
    lw {p}, 8 * (\at)({own})
    take_step {x}, {p}, {rhs}, \k, {q}
    lw {y}, 8 * (\at) + 4({each})
    sw {q}, 8 * (\at)({own})
    andi {y}, {y}, 7
    mul {y}, {y}, {q}
    sub {x}, {x}, {y}
    total {x}, {q}, {y}, {p}
.endm
