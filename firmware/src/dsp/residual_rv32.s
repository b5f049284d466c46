// 8 r of a place in `west`, which has its west's piston before, and its own piston in `p`. The place is `node` bytes
// from where the pointers of nodes are; `east` becomes the next place's west. Where there is no node nothing else is
// read, and it goes on at 99. Loads stand apart from what needs them.
.macro residual node, west, east
    lw {k}, \node / 2({each})
    lw \east, \node({east})
    beqz {k}, 99f
    lw {x}, \node({north})
    lw {y}, \node({south})
    lw {p}, \node({own})
    lw {rhs}, \node + 4({own})
    add \west, \west, \east
    add {x}, {x}, {y}
    andi {y}, {k}, 7
    mul {y}, {y}, {p}
    add \west, \west, {x}
    sub \west, \west, {y}
    slli \west, \west, 2
    add \west, \west, {rhs}
.endm
