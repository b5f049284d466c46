.macro place node, west, east
    residual \node, \west, \east
    // The square of r / 8, and the piston: all of it, and that without the lowest bits.
    srai \west, \west, 6
    mul {x}, \west, \west
    mulh {y}, \west, \west
    add {squares_low}, {squares_low}, {x}
    sltu {x}, {squares_low}, {x}
    add {squares_high}, {squares_high}, {y}
    add {squares_high}, {squares_high}, {x}
    add {low}, {low}, {p}
    srai {p}, {p}, 14
    add {high}, {high}, {p}
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
