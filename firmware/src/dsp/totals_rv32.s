// A place, with its west before in `west`, which is lost; `east` becomes the next place's west.
.macro place node, west, east
    around \node, 4, \west, \east
    // 2 r.
    andi {y}, {k}, 7
    mul {y}, {y}, {p}
    add \west, \west, {rhs}
    sub \west, \west, {y}
    total \west, {p}, {x}, {y}
99:
.endm
