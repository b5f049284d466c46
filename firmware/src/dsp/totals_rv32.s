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
    addi {east}, {east}, 32
    addi {north}, {north}, 32
    addi {south}, {south}, 32
.endm
