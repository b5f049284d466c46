// The step of a node, `at` places from the first one, around which is `x`.
.macro step at, k
    residual \at, \k
    mulh {x}, {x}, \k
    add {p}, {p}, {x}
    limit {p}, {x}, {y}
    sw {p}, 8 * (\at)({own})
.endm
