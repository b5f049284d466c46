// The step of a node, `at` places from the first one, around which is `x`.
.macro step at, k
    lw {p}, 8 * (\at)({own})
    lw {rhs}, 8 * (\at) + 4({own})
    andi {y}, \k, 7
    mul {y}, {y}, {p}
    sub {x}, {x}, {y}
    slli {x}, {x}, 2
    add {x}, {x}, {rhs}
    mulh {x}, {x}, \k
    add {p}, {p}, {x}
    // The upper limit, the lower one, and rounding.
    srai {x}, {p}, 31
    and {p}, {p}, {x}
    add {x}, {p}, {room}
    srai {y}, {x}, 31
    and {x}, {x}, {y}
    sub {p}, {p}, {x}
    ori {p}, {p}, 1
    sw {p}, 8 * (\at)({own})
.endm
