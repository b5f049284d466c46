.macro place node, west, east
    residual \node, \west, \east
    // The step.
    mulh \west, \west, {k}
    add {p}, {p}, \west
    limit {p}, {x}, {y}
    sw {p}, \node({own})
99:
.endm
