// A place, `node` bytes from where the pointers are. `west` has its west before and is lost; `east` becomes the next
// place's west. Loads stand apart from what needs them.
.macro place node, west, east
    lw {k}, \node + 4({each})
    lw \east, \node({east})
    beqz {k}, 99f
    lw {x}, \node({north})
    lw {y}, \node({south})
    lw {p}, \node({own})
    lw {rhs}, \node + 4({own})
    add \west, \west, \east
    add {x}, {x}, {y}
    // 2 r.
    andi {y}, {k}, 7
    mul {y}, {y}, {p}
    add \west, \west, {x}
    sub \west, \west, {y}
    add \west, \west, {rhs}
    total \west, {p}, {x}, {y}
99:
.endm
