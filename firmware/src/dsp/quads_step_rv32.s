// The step of a node, `at` places from the first one, around which is `x`.
.macro step at, k
    lw {rhs}, 8 * (\at) + 4({own})
    lw {p}, 8 * (\at)({own})
    take_step {x}, {p}, {rhs}, \k, {x}
    sw {x}, 8 * (\at)({own})
.endm
