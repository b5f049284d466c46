// A bracket makes up for a fraction bit that its step is short of.
.macro widen x
    sll \x, \x, {short_by}
.endm
// A place, with its west before in `west`, which is lost; `east` becomes the next place's west.
.macro place node, west, east
    around \node, 0, \west, \east
    take_step \west, {p}, {rhs}, {k}, \west
    sw \west, \node({own})
99:
.endm
