.macro place node, west, east
    residual \node, \west, \east
    total \west, {p}, {x}, {y}
99:
.endm
