.macro place node, west, east
    residual \node, \west, \east
    // The step.
    mulh \west, \west, {k}
    add {p}, {p}, \west
    // The upper limit, the lower one, and rounding.
    srai {x}, {p}, 31
    and {p}, {p}, {x}
    add {x}, {p}, {room}
    srai {y}, {x}, 31
    and {x}, {x}, {y}
    sub {p}, {p}, {x}
    ori {p}, {p}, 1
    sw {p}, \node({own})
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
