// A bracket makes up for a fraction bit that its step is short of.
.macro widen x
    sll \x, \x, {short_by}
.endm
// A place, `node` bytes from where the pointers are. `west` has its west before and is lost; `east` becomes the next
// place's west. Loads stand apart from what needs them.
.macro place node, west, east
    lw {k}, \node({each})
    lw \east, \node({east})
    beqz {k}, 99f
    lw {x}, \node({north})
    lw {y}, \node({south})
    lw {p}, \node({own})
    lw {rhs}, \node + 4({own})
    add \west, \west, \east
    add {x}, {x}, {y}
    add \west, \west, {x}
    take_step \west, {p}, {rhs}, {k}, \west
    sw \west, \node({own})
99:
.endm
