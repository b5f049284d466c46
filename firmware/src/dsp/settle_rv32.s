// A command, `node` bytes from where the pointer is: the mean off, then the lower and the upper limit.
.macro place node
    lh {x}, \node / 2 + 2({each})
    lw {c}, \node({own})
    beqz {x}, 99f
    lw {d}, \node + 4({own})
    sub {c}, {c}, {least_c}
    sgtz {x}, {c}
    sub {d}, {d}, {least_d}
    sgtz {y}, {d}
    mul {c}, {c}, {x}
    mul {d}, {d}, {y}
    sub {c}, {c}, {room}
    sub {d}, {d}, {room}
    srai {x}, {c}, 31
    srai {y}, {d}, 31
    and {c}, {c}, {x}
    and {d}, {d}, {y}
    add {c}, {c}, {limit}
    add {d}, {d}, {limit}
    sw {c}, \node({own})
    sw {d}, \node + 4({own})
99:
.endm
.macro even node
    place \node
.endm
.macro odd node
    place \node
.endm
.macro step
.endm
