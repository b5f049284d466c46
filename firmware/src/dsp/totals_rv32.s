// A place, `node` bytes from where the pointers of nodes are. `west` becomes its own; `east` is the next
// place's west. Loads stand apart from what needs them.
.macro place node, west, east
    lw {k}, \node / 2({each})
    lw \east, \node({east})
    beqz {k}, 99f
    lw {x}, \node({north})
    lw {y}, \node({south})
    lw {p}, \node({own})
    lw {rhs}, \node + 4({own})
    // 8 r.
    add \west, \west, \east
    add {x}, {x}, {y}
    andi {y}, {k}, 7
    mul {y}, {y}, {p}
    add \west, \west, {x}
    sub \west, \west, {y}
    slli \west, \west, 2
    add \west, \west, {rhs}
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
