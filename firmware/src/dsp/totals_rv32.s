.macro place node, west, east
    residual \node, \west, \east
    total \west, {p}, {x}, {y}
99:
.endm
.macro even node
    place \node, {a}, {b}
.endm
.macro odd node
    place \node, {b}, {a}
.endm
.macro step
    addi {east}, {east}, 64
    addi {north}, {north}, 64
    addi {south}, {south}, 64
.endm
