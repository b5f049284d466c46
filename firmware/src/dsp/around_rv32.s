// The sum of a place's sides, `node` bytes from where the pointers are, in `west`, which has its west before, and its
// unknown in `p` and `rhs`; `east` becomes the next place's west. Where this word of its coupling, in `k`, is 0 nothing
// else is read, and it goes on at 99. Loads stand apart from what needs them.
.macro around node, word, west, east
    lw {k}, \node + \word({each})
    lw \east, \node({east})
    beqz {k}, 99f
    lw {x}, \node({north})
    lw {y}, \node({south})
    lw {p}, \node({own})
    lw {rhs}, \node + 4({own})
    add \west, \west, \east
    add {x}, {x}, {y}
    add \west, \west, {x}
.endm
// Nothing moves but the pointers that all have.
.macro step
.endm
